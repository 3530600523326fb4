"""Search for missing effects of anything that moves along one coordinate: filter, fit, forward selection."""
