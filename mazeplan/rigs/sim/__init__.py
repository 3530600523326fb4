"""Simulated rigs on MuJoCo: the generated machine, a user's own model, many rigs at once, and undeclared effects."""
