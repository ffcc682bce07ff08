"""Bridges: what the tap tells, sent on to others by processes of their own."""
