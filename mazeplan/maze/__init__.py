"""The maze: its geometry, the map file, routes through it, openings learned from where the ball changed rings."""
