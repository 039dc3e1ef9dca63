"""The stage behind `pumps weights show`."""
