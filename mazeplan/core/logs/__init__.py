"""Measurements: run logs and tables."""
