"""A robot's motion: how far it may have come between two looks at a panel or at the map."""

from __future__ import annotations

# Standard deviations of what is not known of its velocity: no wheeled robot that looks for panels is quicker.
MAX_SPEED_M_S, MAX_TURN_RAD_S = 3.0, 6.0
