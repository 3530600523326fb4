"""Pure functions: angles, compiled helpers, fingerprints."""
