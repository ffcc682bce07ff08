"""Where frames come from. Nothing after `Camera.read` can tell which kind it is."""
