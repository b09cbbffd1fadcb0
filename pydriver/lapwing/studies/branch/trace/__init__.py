"""A branch followed one way: its steps, its special points, and what becomes of it at a border."""
