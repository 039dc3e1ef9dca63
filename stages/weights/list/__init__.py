"""The stage behind `pumps weights list`."""
