"""Maps: every crossing point of two or more axes, cut into shards that survive their process."""
