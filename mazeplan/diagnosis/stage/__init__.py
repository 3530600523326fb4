"""Servos and tilt sensor of a record against those of a model, and how the plate moved."""
