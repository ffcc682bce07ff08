"""ArUco dictionaries, and what a codeword shows on a panel."""
