"""The gear pair as a mathematical object: transmission error, oscillator, linear response."""
