"""Measured transmission errors: fits of samples with noise, and the intervals that follow."""
