"""Studies: one question each, asked of the engine."""
