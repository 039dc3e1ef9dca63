"""The version of pumps that artefacts record (a test compares it with pyproject.toml)."""

PUMPS_VERSION = "0.1.0"
