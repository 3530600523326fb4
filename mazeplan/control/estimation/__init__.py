"""State estimation: from delayed, noisy samples to the state at the moment when the next command acts."""
