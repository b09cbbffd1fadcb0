"""What is checked of a deck beyond single keys, and the objects made from it."""
