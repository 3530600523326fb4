"""From formulas to code: symbols, the equation of motion, generated source and compiled functions."""
