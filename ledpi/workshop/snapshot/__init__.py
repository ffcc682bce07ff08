"""One frame as an annotated picture: as seen, its bands amplified, the cells, what was dropped and why."""
