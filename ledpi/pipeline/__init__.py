"""The path of one frame, and what it gives."""
