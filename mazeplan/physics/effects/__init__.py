"""The effects, one family a file: on the ball, of openings, of the rig; and terms without a name."""
