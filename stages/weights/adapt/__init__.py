"""The stage behind `pumps weights adapt`."""
