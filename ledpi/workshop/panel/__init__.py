"""The panel itself: its frequencies, its build sheet, its driver's firmware."""
