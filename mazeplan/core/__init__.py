"""The ground floor: records, errors, pure functions, run logs and tables. It knows no maze, no rig and no model."""
