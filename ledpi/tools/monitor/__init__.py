"""The display of `ledpi monitor` for a running daemon."""
