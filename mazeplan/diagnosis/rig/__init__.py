"""The diagnosis of a whole rig: all rings at once, against a reference."""
