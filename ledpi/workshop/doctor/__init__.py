"""`ledpi doctor`: what the daemon needs, looked at one by one, each ✗ with what to do about it."""
