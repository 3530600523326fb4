"""From formulas to code: symbols, the equation of motion, generated source, compiled functions and arrays."""
