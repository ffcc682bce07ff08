"""Recordings and pictures: read, written, checked."""
