"""The stage behind `pumps calibrate`."""
