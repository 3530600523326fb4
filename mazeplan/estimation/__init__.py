"""From late and noisy samples to the state at the moment when the next command acts."""
