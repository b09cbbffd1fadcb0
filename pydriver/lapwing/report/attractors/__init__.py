"""Attractors and basins in words."""
