"""Writing motions as tables: CSV with one line per frame, Parquet with one row per frame and joint.

Positions are joints' places in the world, metres, Y up; rotations are global unit quaternions, xyzw.
"""

from __future__ import annotations

import csv
import io
import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from data_schemas.skeleton import BODY_GROUPS, Motion, Skeleton
from stages.shared.formats.text_cells import text_cell
from stages.shared.kinematics.forward_numpy import positions_of

VALUES = ("both", "positions", "rotations")
_PLACES = ("x", "y", "z")
_TURNS = ("qx", "qy", "qz", "qw")


def csv_of_motion(skeleton: Skeleton, motion: Motion, values: str = "both", decimals: int = 7) -> bytes:
    """The bytes of a CSV: `frame`, `time`, then `NAME.x` to `NAME.z` and `NAME.qx` to `NAME.qw` of every joint.

    Args:
        values: one of VALUES; `pumps ingest positions` reads a table of positions only.

    A name that a spreadsheet would take for a formula has an apostrophe before it (`text_cells`).
    """
    chosen = {"both": (_PLACES, _TURNS), "positions": (_PLACES,), "rotations": (_TURNS,)}[values]
    blocks = [
        positions_of(skeleton, motion) if axes is _PLACES else motion.rotations.astype(float) for axes in chosen
    ]
    table = np.concatenate(blocks, axis=-1).reshape(motion.frames, -1)
    columns = ["frame", "time", *(f"{name}.{axis}" for name in skeleton.names for axes in chosen for axis in axes)]
    out = io.StringIO(newline="")
    csv.writer(out, lineterminator="\n").writerow(map(text_cell, columns))
    pattern = "%d,%.9g," + ",".join([f"%.{decimals}f"] * table.shape[1]) + "\n"
    table = np.round(table, decimals) + 0.0  # + 0.0 turns -0.0 into 0.0
    for frame, row in enumerate(table.tolist()):
        out.write(pattern % (frame, frame / motion.fps, *row))
    return out.getvalue().encode()


def parquet_of_motion(skeleton: Skeleton, motion: Motion, clip: str, licence: str = "") -> bytes:
    """The bytes of a Parquet file: one row for every frame and joint, frames outermost.

    Columns: clip, frame, time (seconds), joint, group (null outside the body), x, y, z (float64),
    qx, qy, qz, qw (float32). The file's metadata hold fps, names, parents, offsets_m, units and licence.
    """
    frames, joints = motion.frames, skeleton.joints
    places = positions_of(skeleton, motion).reshape(-1, 3)
    turns = motion.rotations.reshape(-1, 4)
    index = np.tile(np.arange(joints, dtype=np.int32), frames)
    groups = [BODY_GROUPS[group] if group >= 0 else None for group in skeleton.groups]
    kinds = sorted({group for group in groups if group})
    by_joint = pa.array([kinds.index(group) if group else None for group in groups], pa.int32())
    columns = {
        "clip": pa.DictionaryArray.from_arrays(np.zeros(frames * joints, np.int32), pa.array([clip])),
        "frame": np.repeat(np.arange(frames, dtype=np.int32), joints),
        "time": np.repeat(np.arange(frames) / motion.fps, joints),
        "joint": pa.DictionaryArray.from_arrays(index, pa.array(skeleton.names)),
        "group": pa.DictionaryArray.from_arrays(by_joint.take(pa.array(index)), pa.array(kinds, pa.string())),
        **{axis: places[:, i] for i, axis in enumerate(_PLACES)},
        **{axis: turns[:, i] for i, axis in enumerate(_TURNS)},
    }
    about = {
        "fps": motion.fps, "names": list(skeleton.names), "parents": skeleton.parents.tolist(),
        "offsets_m": skeleton.offsets.tolist(), "units": "metres, seconds, Y up, global unit quaternions xyzw",
        "licence": licence,
    }  # fmt: skip
    table = pa.table(columns).replace_schema_metadata({"pumps": json.dumps(about)})
    out = io.BytesIO()
    pq.write_table(table, out, compression="zstd")
    return out.getvalue()
