"""The formats that pumps writes, by name and by the suffix of their files."""

from __future__ import annotations

from pathlib import Path

from data_schemas.errors import UsageError
from data_schemas.skeleton import Motion, Skeleton
from stages.shared.formats.amass_write import NOT_SMPL, amass_of_motion, smpl_layout_of
from stages.shared.formats.bvh_of_motion import bvh_of_motion
from stages.shared.formats.table_write import csv_of_motion, parquet_of_motion
from stages.shared.humanoid.anatomy import anatomy_of
from stages.shared.kinematics.forward_numpy import positions_of

SUFFIXES = {"bvh": ".bvh", "glb": ".glb", "amass": ".npz", "csv": ".csv", "parquet": ".parquet"}


def written_format(path: Path) -> str:
    """The format of a file's suffix. Raises UsageError if pumps does not write such files."""
    by_suffix = {suffix: name for name, suffix in SUFFIXES.items()}
    found = by_suffix.get(path.suffix.lower())
    if found is None:
        raise UsageError(
            f"{path.name} has a suffix that pumps does not write.", f"Name a file of {', '.join(by_suffix)}."
        )
    return found


def bytes_of_motion(
    chosen: str, skeleton: Skeleton, motion: Motion, name: str, *, licence: str = "", values: str = "both"
) -> tuple[bytes, list[str]]:
    """A motion as the bytes of a file.

    Args:
        chosen: a name of SUFFIXES.
        name: the clip's name, written if the format has a place for it.
        values: of CSV: "both", "positions" or "rotations".

    Returns: the bytes, and notes on what the format cannot hold, one sentence each.
    Raises: InputError if a BVH is to be written and the skeleton has no BVH header.
    """
    if chosen == "bvh":
        return bvh_of_motion(skeleton, motion, name), []
    if chosen == "glb":
        from stages.shared.formats.gltf_write import glb_of_motion  # its library takes long to load

        first = positions_of(skeleton, motion)[:1]
        rest = anatomy_of(skeleton, first, motion.rotations[:1].astype(float)).rest
        bind = "first" if rest == "no human pose" else "rest"
        return glb_of_motion(skeleton, motion, name, bind=bind, licence=licence), []
    if chosen == "amass":
        data, notes = amass_of_motion(skeleton, motion, licence)
        if smpl_layout_of(skeleton) is None:
            notes.insert(0, f"AMASS-like, and not SMPL: surface_model_type is '{NOT_SMPL}'.")
        return data, notes
    if chosen == "csv":
        return csv_of_motion(skeleton, motion, values), []
    return parquet_of_motion(skeleton, motion, name, licence), []
