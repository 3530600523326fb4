"""A run: its specification, its parts, its loop, its record; and many runs (`campaign`)."""
