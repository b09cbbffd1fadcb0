"""Speed against error: this engine and what a user would pick instead, measured in one run."""
