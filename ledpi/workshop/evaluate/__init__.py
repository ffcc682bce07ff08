"""Rates and errors of reading, and what is mistaken for a panel: rendered with a seed, or from real frames."""
