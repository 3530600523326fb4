"""Plans and how they are followed: the solver, its costs, tracking, and the passage through an opening."""
