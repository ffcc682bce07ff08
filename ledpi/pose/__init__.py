"""From corners to places. Pure: no threads, clocks, files or cameras."""
