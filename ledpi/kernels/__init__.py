"""The hot loops in C, each beside the numpy code that it repeats and that is used where it is not compiled."""
