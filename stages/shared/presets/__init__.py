"""The presets: one TOML file each, with a table for every stage it has something to say of."""
