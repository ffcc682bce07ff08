"""From rough squares to corners, a fraction of a pixel exact."""
