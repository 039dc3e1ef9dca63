"""Clips put on other rigs, to measure motions that are known on skeletons that are not."""
