"""A skeleton as plain data for JSON, stored in a checkpoint so that its output can be written without the rig."""

from __future__ import annotations

from typing import Any

import numpy as np

from data_schemas.errors import InputError
from data_schemas.motion import fault_of_skeleton
from data_schemas.skeleton import Skeleton


def plain_of_skeleton(skeleton: Skeleton) -> dict[str, Any]:
    """The skeleton as lists, numbers and text."""
    return {
        "names": list(skeleton.names),
        "parents": np.asarray(skeleton.parents).tolist(),
        "offsets": np.asarray(skeleton.offsets, float).tolist(),
        "tails": np.asarray(skeleton.tails, float).tolist(),
        "groups": np.asarray(skeleton.groups).tolist(),
        "sampled": [bool(seen) for seen in skeleton.sampled],
        "root": int(skeleton.root),
        "unit_m": float(skeleton.unit_m),
        "up_axis": skeleton.up_axis,
        "header": skeleton.header,
    }


def skeleton_of_plain(values: Any) -> Skeleton:
    """The skeleton from the values of `plain_of_skeleton`. Raises InputError if they are invalid."""
    try:
        skeleton = Skeleton(
            names=tuple(str(name) for name in values["names"]),
            parents=np.array(values["parents"], np.int32),
            offsets=np.array(values["offsets"], np.float64),
            tails=np.array(values["tails"], np.float64),
            groups=np.array(values["groups"], np.int8),
            sampled=np.array(values["sampled"], bool),
            root=int(values["root"]),
            unit_m=float(values["unit_m"]),
            up_axis=str(values["up_axis"]),
            header=str(values["header"]),
        )
        fault = fault_of_skeleton(skeleton)
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise InputError(f"The stored skeleton is damaged ({error}).", "Make its artefact again.") from None
    if fault:
        raise InputError(f"The stored skeleton {fault}.", "Make its artefact again.")
    return skeleton
