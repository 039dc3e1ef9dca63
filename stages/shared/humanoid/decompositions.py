"""How the body is divided into parts (de Clermont Gallerande et al. 2025, 3.1). Imports no numpy, for help's sake."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

LIMBS = ("left_arm", "right_arm", "left_leg", "right_leg")

# Number of parts -> name of each part -> its body groups. The part with the spine comes first.
DECOMPOSITIONS: Mapping[int, Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {
        1: {"whole": ("spine", *LIMBS)},
        2: {"upper": ("spine", "left_arm", "right_arm"), "lower": ("left_leg", "right_leg")},
        3: {"spine": ("spine",), "arms": ("left_arm", "right_arm"), "legs": ("left_leg", "right_leg")},
        5: {name: (name,) for name in ("spine", *LIMBS)},
    }
)
PART_NAMES = tuple(dict.fromkeys(name for parts in DECOMPOSITIONS.values() for name in parts))
