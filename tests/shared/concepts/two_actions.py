"""A concepts artefact of two actions, made from halves of two embedded clips."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from data_schemas.artefact import write_artefact
from data_schemas.concepts import ClipRow, ConceptsWriter, StoredBody
from stages.shared.concepts.body_positions import body_of, body_positions
from stages.shared.concepts.segmenting import segmented
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.kinematics.resampling import resample
from stages.train.concepts.config import Config
from stages.train.concepts.run import run

CLIPS = Path(__file__).resolve().parents[3] / "stages" / "shared" / "clips"
ACTIONS = ("getup_faceup", "walk")


def write_two_actions(path: Path) -> None:
    """Two training clips and two test clips at 20 frames a second, on one rig."""
    with write_artefact(path, "concepts", stage="t", config={}) as draft, ConceptsWriter(draft.folder, 200) as writer:
        for name in ACTIONS:
            skeleton, motion, _ = motion_of(read_bvh((CLIPS / f"{name}.bvh").read_bytes(), name))
            motion, body = resample(motion, 20), body_of(skeleton)
            stored = StoredBody(body.names, body.parents, body.groups)
            writer.add_body(stored)
            places = body_positions(skeleton, motion, body)
            for split, part in (("train", places[::2]), ("test", places[1::2])):
                row = ClipRow(
                    f"{name}.{split}", name, "0" * 64, stored.id, len(part), 20.0, len(part) / 20, split, "CC0"
                )
                writer.add(row, segmented(part, body.scale, 20.0, 200, 4.0, name))
            writer.add_centres(name, np.zeros((1, len(body.names), 3)))
        draft.licences.add("CC0")


def train_two_actions(folder: Path) -> Path:
    """Motion concepts of both actions, after two steps: the checkpoint."""
    write_two_actions(folder / "c")
    run(
        Config(
            concepts=folder / "c", output=folder / "w", steps=2, batch=4, window=24, width=16, latent=4, warmup=1,
            validate_every=2, checkpoint_every=2, device="cpu",
        )
    )  # fmt: skip
    return folder / "w"
