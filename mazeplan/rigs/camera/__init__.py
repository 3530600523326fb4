"""The overhead camera: how it maps (pinhole), where the plate is (markers), where the ball is (detector), what it
would see (render), where pictures come from (source), and how all that is found out (calibration)."""
