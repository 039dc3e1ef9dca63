"""The version of pumps, as artefacts record it (a test holds it against pyproject.toml)."""

PUMPS_VERSION = "0.1.0"
