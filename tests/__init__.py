"""What ledpi promises, and what holds it to that."""
