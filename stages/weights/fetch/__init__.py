"""The stage behind `pumps weights fetch`."""
