"""From evidence to an ID: every word, and whatever else it might be."""
