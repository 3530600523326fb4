"""Models of ball and stage: effects by name, fits from logs, model files, and their compiled forms for prediction
and planning."""
