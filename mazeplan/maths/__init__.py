"""Pure functions: angles, integration, box-constrained quadratic programs, linear-quadratic regulators."""
