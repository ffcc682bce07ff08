"""How often panels are read, how exactly, and what is mistaken for one: rendered with a seed, or from real frames."""
