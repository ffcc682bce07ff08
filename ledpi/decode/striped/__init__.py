"""Panels that dark bands cut into pieces, as at short exposures: from a picture to corners."""
