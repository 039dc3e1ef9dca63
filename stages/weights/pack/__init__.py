"""The stage behind `pumps weights pack`."""
