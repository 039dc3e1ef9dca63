"""The stage behind `pumps weights vary`."""
