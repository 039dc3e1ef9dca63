"""2D keypoints of a motion, as a camera and a detector would give them."""
