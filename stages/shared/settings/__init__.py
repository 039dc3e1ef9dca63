"""Where settings come from: defaults, presets, files, flags; and how a run's folder keeps them."""
