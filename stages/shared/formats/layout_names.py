"""Names of the layouts of keypoints, for settings, which load no arrays."""

from __future__ import annotations

KEYPOINT_LAYOUTS = ("coco17", "body25", "mediapipe33", "h36m17", "halpe26")
