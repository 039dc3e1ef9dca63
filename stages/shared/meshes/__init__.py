"""Meshes of one connectivity: their graph, its spectral basis, bodies that move them, and measures of them."""
