"""What `ledpi monitor` shows of a running daemon."""
