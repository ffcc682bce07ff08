"""`python -m ledpi`: the command line where the command itself is not on the path."""

from ledpi.cli import main

main()
