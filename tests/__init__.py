"""Promises of ledpi, and what holds it to them."""
