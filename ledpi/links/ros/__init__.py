"""ROS 2 messages without ROS: what a frame is in them, and their bytes."""
