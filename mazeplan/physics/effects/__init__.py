"""The effects, one file per family: on the ball, of openings, of the rig; and terms without a name."""
