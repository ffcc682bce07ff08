"""From a picture to rough squares: what may be a panel, and where."""
