"""Bags: recordings as MCAP files of ROS 2 messages, and back."""
