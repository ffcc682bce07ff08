"""The tap: what a running daemon sees, for others on the same machine."""
