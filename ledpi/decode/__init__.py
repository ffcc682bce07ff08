"""From a picture to the IDs in it. Pure: no threads, clocks, files or cameras."""
