"""The stage behind `pumps weights calibrate`."""
