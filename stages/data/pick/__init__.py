"""A few test clips, copied out of their sources as BVH files."""
