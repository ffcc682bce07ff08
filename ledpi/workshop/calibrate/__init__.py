"""Workshop tools that measure a camera or a panel. `ledpi run` never imports them."""
