"""Faults on a schedule, for any rig: kinds, the YAML file of a schedule, and the wrapper that makes a rig fail."""
