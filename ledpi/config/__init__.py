"""config.yaml and the files that it names: lens, map, robot."""
