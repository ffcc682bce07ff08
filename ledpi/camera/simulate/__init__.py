"""Scenes with blinking panels, and the rolling-shutter renderer that photographs them."""
