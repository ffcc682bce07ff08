"""The source paper's method, step by step: the baseline that the other decoder is compared with."""
