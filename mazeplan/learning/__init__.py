"""Models of ball and stage from logs: samples, fits, Gaussian processes, model files, comparison."""
