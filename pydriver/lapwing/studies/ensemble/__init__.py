"""Ensembles: draws of numbers that are not the same in every pair, and what is sure of them."""
