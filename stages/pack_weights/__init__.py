"""The stage behind `pumps pack-weights`."""
