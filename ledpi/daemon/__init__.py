"""The daemon: threads, ring, service, health, reload."""
