"""Critical values: above which nothing separates, rattles or hits the back."""
