"""A panel's picture as one equation, and its fit to light."""
