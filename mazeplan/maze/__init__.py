"""The maze: geometry, map file, routes, drawing, and maps learned from the ball's motion."""
