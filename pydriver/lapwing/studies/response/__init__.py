"""One motion: its history, its period, its stability, its forces."""
