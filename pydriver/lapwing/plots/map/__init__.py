"""Figures of a map: a plane of two parameters, a cell for each run."""
