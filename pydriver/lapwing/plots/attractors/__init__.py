"""Figures of attractors and their basins."""
