"""Models of the parts of a rig: stage, tilt sensor and camera."""
