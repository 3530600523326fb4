"""The overhead camera: projection, tilt of the plate by markers, the ball, sources of pictures, calibration."""
