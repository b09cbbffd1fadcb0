"""Many motions along a range of one parameter."""
