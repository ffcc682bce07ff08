"""Sources of frames. Nothing after `Camera.read` can tell which kind it is."""
