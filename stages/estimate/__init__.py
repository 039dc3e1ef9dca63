"""Motion from 2D keypoints."""
