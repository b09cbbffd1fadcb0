"""A periodic motion between its events: unknowns, equations, the curve they lie on."""
