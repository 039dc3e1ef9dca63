"""pumps from Python: read any motion file, fill it between keyframes, put it on another rig, write it back.

    import pumps

    motion = pumps.load("walk.bvh")
    filled = pumps.infill(motion, keyframes=[0, 15, 40])
    pumps.save(filled, "filled.bvh")

docs/python.md shows each function. Everything else in this package is an implementation detail. Importing it loads no
torch; functions load it when they need it. Import pumps before torch, so that torch's waiting threads sleep; where
torch was imported first, pumps computes in one thread.
"""

from __future__ import annotations

from data_schemas.errors import InputError, PumpsError, UsageError
from data_schemas.version import PUMPS_VERSION as __version__
from pumps.adapting import adapt
from pumps.files import load, load_clips, read_clips, save, write_clips
from pumps.filling import infill, infill_samples, retarget
from pumps.motion import Motion
from stages.shared.threads import let_waiting_threads_sleep

__all__ = [
    "InputError",
    "Motion",
    "PumpsError",
    "UsageError",
    "__version__",
    "adapt",
    "infill",
    "infill_samples",
    "load",
    "load_clips",
    "read_clips",
    "retarget",
    "save",
    "write_clips",
]

let_waiting_threads_sleep()
