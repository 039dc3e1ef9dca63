"""The networks of motion concepts: transition generator, anchor recogniser, anchor and transition refiners."""
