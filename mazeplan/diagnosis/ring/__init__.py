"""The diagnosis of a ball in one ring, as a bead on a circle."""
