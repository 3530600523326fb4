"""Planning and control: the iLQG solver, its costs, tracking, passage of openings, state estimation."""
