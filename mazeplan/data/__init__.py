"""Measurements: run logs, tables, smoothing, excitation."""
