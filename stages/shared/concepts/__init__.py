"""Motion concepts: what an action's motions have in common, as anchor poses and the transitions between them."""
