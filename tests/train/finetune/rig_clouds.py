"""Three embedded clips of one rig as clouds, to train tiny networks of a task on."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from data_schemas.artefact import write_artefact
from data_schemas.clips import ClipRow
from data_schemas.motion import MotionWriter
from stages.sample_tpc.config import Config as SampleConfig
from stages.sample_tpc.run import run as sample
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of

RIG = "stages/shared/clips/walk.bvh"
SIZES = {"width": 24, "heads": 2, "key_layers": 1, "fill_layers": 1, "frame_layers": 1}
SMALL: dict[str, Any] = {
    "from_": "scratch", "steps": 4, "batch": 2, "window": 24, "warmup": 2, "validate_every": 4, "device": "cpu",
    "overwrite": True, "synthesiser": SIZES, "latent_width": 16, "average": 0.5,
}  # fmt: skip


def write_rig_clouds(folder: Path) -> None:
    """Motions `folder/motion` and clouds `folder/tpc`: a clip each to train, to validate and to test on."""
    with (
        write_artefact(folder / "motion", "motion", stage="test", config={}, licences=["zlib"]) as draft,
        MotionWriter(draft.folder) as writer,
    ):
        for name, split in (("walk", "train"), ("run", "val"), ("dance_a", "test")):
            path = Path(f"stages/shared/clips/{name}.bvh")
            skeleton, motion, _ = motion_of(read_bvh(path.read_bytes(), path.name))
            seconds, own = motion.frames / motion.fps, writer.add_skeleton(skeleton)
            row = ClipRow(name, f"{name}.bvh", "0" * 64, own, motion.frames, motion.fps, seconds, split, "zlib")
            writer.add_clip(row, motion)
    sample(SampleConfig(motion=folder / "motion", output=folder / "tpc", points=32))
