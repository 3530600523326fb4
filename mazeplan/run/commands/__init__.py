"""What the commands do, for the command line and for Python (`mazeplan.evaluate`, `mazeplan.learn` ...)."""
