"""ARX models and the searches for their delay and orders."""
