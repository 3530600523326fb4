"""The overhead camera. Modules: projection (pinhole), tilt of the plate (markers), the ball (detector), sources of
pictures (source), calibration."""
