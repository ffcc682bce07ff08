"""ArUco dictionaries, and what a word shows on a panel."""
