"""The hot loops in C, and how they are called: core.h declares them, `library` loads them."""
