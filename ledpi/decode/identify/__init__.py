"""From evidence to an ID: each codeword, and the hypotheses that compete with it."""
