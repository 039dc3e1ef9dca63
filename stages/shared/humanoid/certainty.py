"""How often a body that was found is right, measured: the number that `pumps inspect` prints as "sure".

`benchmarks/body_certainty.py` measures it on people's rigs and on creatures, half of the weight each, and prints the
table of docs/evaluation.md, from which the shares below are copied; a test compares the two. A share is
(right + 1) / (taken + 2), so that it is below 1 even for a few bodies that are all right. Shares never fall
where the margin rises.
"""

from __future__ import annotations

# Share of right ones among the bodies that names identify.
SURE_BY_NAMES = 0.99
# Least margin of the limbs over the next best choice, and the share of right ones from there to the next.
SURE_BY_SHAPE = ((0.0, 0.06), (0.5, 0.5), (0.95, 0.97))


def sure_of_margin(margin: float) -> float:
    """The share of right ones among bodies found by shape with this margin, 0 to 1."""
    return [share for least, share in SURE_BY_SHAPE if margin >= least][-1]
