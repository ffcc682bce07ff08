"""The live page: a process of its own that reads the daemon's tap, and serves what it sees to browsers."""
