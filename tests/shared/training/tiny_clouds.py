"""A small synthetic tpc artefact: a swinging humanoid of twelve bones, for tests of training."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from data_schemas.artefact import write_artefact
from data_schemas.tpc import BoneSet, ClipRow, TpcWriter
from stages.shared.pointcloud.sampling import draw_points

PARENTS = np.array([-1, 0, 1, 2, 2, 4, 2, 6, 0, 8, 0, 10], np.int32)
GROUPS = np.array([0, 0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4], np.int8)
TAILS = np.array(
    [
        [0, 0.2, 0],
        [0, 0.2, 0],
        [0, 0.2, 0],
        [0, 0.2, 0],
        [0.3, 0, 0],
        [0.3, 0, 0],
        [-0.3, 0, 0],
        [-0.3, 0, 0],
        [0.1, -0.4, 0],
        [0, -0.4, 0],
        [-0.1, -0.4, 0],
        [0, -0.4, 0],
    ],
    np.float32,
)


def swinging(rng: np.random.Generator, frames: int) -> tuple[np.ndarray, np.ndarray]:
    """Heads (T, 12, 3) and global rotations (T, 12, 4) of a smooth random motion."""
    times = np.arange(frames) / 30
    waves = [
        rng.normal(size=(1, 12, 3)) * 0.4 * np.sin(2 * np.pi * rate * times + rng.uniform(0, 6))[:, None, None]
        for rate in (0.5, 1.0, 2.0)
    ]
    local = Rotation.from_rotvec(sum(waves).reshape(-1, 3)).as_quat().reshape(frames, 12, 4)
    heads, rotations = np.zeros((frames, 12, 3)), np.zeros((frames, 12, 4))
    rotations[:, 0] = local[:, 0]
    heads[:, 0] = np.stack([times, 1 + 0 * times, 0 * times], 1)
    for bone in range(1, 12):
        parent = PARENTS[bone]
        turn = Rotation.from_quat(rotations[:, parent])
        rotations[:, bone] = (turn * Rotation.from_quat(local[:, bone])).as_quat()
        heads[:, bone] = heads[:, parent] + turn.apply(TAILS[parent])
    return heads.astype(np.float32), rotations.astype(np.float32)


def write_clouds(path: Path, clips: int = 6, frames: int = 60) -> Path:
    """A rigid tpc artefact; every third clip is for validation, one is shorter than a window."""
    rng = np.random.default_rng(0)
    weights = np.linalg.norm(TAILS, axis=1)
    weights = (weights / weights.sum()).astype(np.float32)
    with (
        write_artefact(path, "tpc", stage="sample-tpc", config={}, licences=["CC0"]) as draft,
        TpcWriter(draft.folder) as writer,
    ):
        bones = writer.add_bones(BoneSet(PARENTS, TAILS, GROUPS, weights, *draw_points(weights, 64, rng)))
        for clip in range(clips):
            length = frames if clip else 12
            row = ClipRow(
                f"clip{clip}",
                f"archive{clip % 2}.zip!clip{clip}.bvh",
                "0" * 64,
                bones,
                length,
                30.0,
                length / 30,
                "val" if clip % 3 == 2 else "train",
                "CC0",
            )
            writer.add_rigid(row, *swinging(rng, length))
    return path
