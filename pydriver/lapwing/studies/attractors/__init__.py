"""Every motion that starts lead to: attractors, their shares, and their basins."""
