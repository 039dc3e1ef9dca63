"""Motions in the forms that other programs read."""
