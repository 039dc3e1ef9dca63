"""Numerics of temporal point clouds: drawing, neighbours, pairing, body groups."""
