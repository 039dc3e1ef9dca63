"""The networks of SpecTrHuMS: a spectral autoencoder of meshes and a transformer of its latents; and siMLPe."""
