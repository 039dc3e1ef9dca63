"""Joint lists that people give positions by."""
LISTS: dict[str, tuple] = {}
