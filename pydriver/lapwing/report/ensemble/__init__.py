"""Ensembles in words."""
