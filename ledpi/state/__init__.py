"""The robot's state at every moment: odometry and panels in, one pose with a covariance that holds out. Pure."""
