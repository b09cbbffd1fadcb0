"""Maps in words."""
