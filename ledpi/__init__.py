"""ledpi: the lighting is the marker. See README.md for the way of one frame."""

__version__ = "0.1.0"
