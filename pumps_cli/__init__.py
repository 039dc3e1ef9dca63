"""The commands. Each parses, calls one stage, prints."""
