"""What a run found, in words: made from results alone."""
