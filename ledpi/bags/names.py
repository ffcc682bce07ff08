"""The names of a bag's topics, and of the parts of a recording that no message holds."""

from __future__ import annotations

IMAGE = "/camera/image_raw/compressed"
CAMERA_INFO = "/camera/camera_info"
# std_msgs/String: a line of frames.jsonl, of truth.jsonl, and what the tap tells of each frame.
FRAME, TRUTH, DECODED = "/ledpi/frame", "/ledpi/truth", "/ledpi/decoded"
METADATA = "ledpi.recording"  # the bag's metadata of this name holds recording.yaml, and a dictionary's file
CAMERA_FRAME = "camera_optical_frame"
