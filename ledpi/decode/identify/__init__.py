"""From evidence to an ID: every codeword, and whatever else it might be."""
