"""The networks of PUMPS: frame encoder, cloud decoder, latent motion synthesiser."""
