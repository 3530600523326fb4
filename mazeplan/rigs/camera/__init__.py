"""The overhead camera. Modules: projection (pinhole), tilt of the plate (markers), the ball (detector), rendered
pictures (render), sources of pictures (source), calibration."""
