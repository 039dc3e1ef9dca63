"""A small synthetic humanoid, smooth motions of it, and weights that were never trained."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from data_schemas.artefact import write_artefact
from data_schemas.checkpoint import write_checkpoint
from data_schemas.manifest import open_artefact
from data_schemas.skeleton import Motion, Skeleton
from data_schemas.trainings import Training, TrainingData
from stages.shared.kinematics.rotations import continuous_signs
from stages.shared.networks.layers.sizes import DecoderSizes, EncoderSizes, SynthesiserSizes
from stages.shared.networks.pumps.cloud_decoder import CloudDecoder
from stages.shared.networks.pumps.frame_encoder import FrameEncoder
from stages.shared.networks.pumps.synthesiser import LatentSynthesiser

# name, parent, offset, tail, group, sampled
_JOINTS = [
    ("pelvis", -1, (0, 0, 0), (0, 0.2, 0), 0, True),
    ("chest", 0, (0, 0.2, 0), (0, 0.3, 0), 0, True),
    ("head", 1, (0, 0.3, 0), (0, 0.2, 0), 0, True),
    ("left_arm", 1, (0.2, 0.25, 0), (0.3, 0, 0), 1, True),
    ("left_hand", 3, (0.3, 0, 0), (0.25, 0, 0), 1, True),
    ("left_finger", 4, (0.25, 0, 0), (0.05, 0, 0), 1, False),
    ("right_arm", 1, (-0.2, 0.25, 0), (-0.3, 0, 0), 2, True),
    ("right_hand", 6, (-0.3, 0, 0), (-0.25, 0, 0), 2, True),
    ("left_leg", 0, (0.1, 0, 0), (0, -0.45, 0), 3, True),
    ("left_shin", 8, (0, -0.45, 0), (0, -0.4, 0), 3, True),
    ("right_leg", 0, (-0.1, 0, 0), (0, -0.45, 0), 4, True),
    ("right_shin", 10, (0, -0.45, 0), (0, -0.4, 0), 4, True),
]


def humanoid(*, above: bool = False) -> Skeleton:
    """Twelve joints; `above` puts a joint over the pelvis that is not a part of the body."""
    names, parents, offsets, tails, groups, sampled = (list(column) for column in zip(*_JOINTS, strict=True))
    if above:
        names, parents = ["place", *names], [-1, *(p + 1 for p in parents)]
        offsets, tails = [(0, 0, 0), *offsets], [(0, 0, 0), *tails]
        groups, sampled = [-1, *groups], [False, *sampled]
    return Skeleton(
        tuple(names),
        np.array(parents, np.int32),
        np.array(offsets, float),
        np.array(tails, float),
        np.array(groups, np.int8),
        np.array(sampled),
        root=int(above),
    )


def swinging(skeleton: Skeleton, frames: int, fps: float = 30.0, seed: int = 0) -> Motion:
    """A smooth random motion. Where a joint is above the pelvis, the pelvis carries a translation track."""
    rng = np.random.default_rng(seed)
    times = np.arange(frames) / fps
    shape = (1, skeleton.joints, 3)

    def wave(size: float) -> np.ndarray:
        phase = rng.uniform(0, 6, shape)
        return (
            rng.normal(size=shape) * size * np.sin(2 * np.pi * rng.uniform(0.3, 1.2) * times[:, None, None] + phase)
        )

    local = Rotation.from_rotvec((wave(0.3) + wave(0.3)).reshape(-1, 3)).as_quat().reshape(frames, -1, 4)
    rotations = np.empty_like(local)
    for joint, parent in enumerate(skeleton.parents):
        own = Rotation.from_quat(local[:, joint])
        rotations[:, joint] = (own if parent < 0 else Rotation.from_quat(rotations[:, parent]) * own).as_quat()
    rotations = continuous_signs(rotations)
    walk = np.stack([times, 1 + 0.1 * np.sin(5 * times), 0.3 * np.cos(2 * times)], -1)
    if skeleton.root == 0:
        return Motion(rotations.astype(np.float32), walk.astype(np.float32), fps)
    still = np.tile([1.0, 0.0, 2.0], (frames, 1))
    tracks = walk[:, None].astype(np.float32)
    joint = np.array([skeleton.root], np.int32)
    return Motion(rotations.astype(np.float32), still.astype(np.float32), fps, joint, tracks)


def write_random_weights(folder: Path, seed: int = 0, trained_on: TrainingData | None = None) -> Path:
    """Folder with `ae` and `lms` whose networks are tiny and random: results mean nothing and repeat exactly."""
    torch.manual_seed(seed)
    encoder_sizes = EncoderSizes(width=8, blocks=2, neighbours=4, heads=2)
    decoder_sizes = DecoderSizes(width=32, layers=1, heads=2, noise=8, point_width=16, point_hidden=8)
    synthesiser_sizes = SynthesiserSizes(width=32, heads=2, key_layers=1, fill_layers=1, frame_layers=1)
    encoder = FrameEncoder(encoder_sizes)
    decoder = CloudDecoder(encoder.latent_width, decoder_sizes)
    synthesiser = LatentSynthesiser(encoder.latent_width, synthesiser_sizes)
    with torch.no_grad():  # a fresh synthesiser adds nothing; one for tests must do something
        for parameter in synthesiser.parameters():
            parameter.add_(0.2 * torch.randn_like(parameter))
    both = {f"encoder.{k}": v for k, v in encoder.state_dict().items()}
    both |= {f"decoder.{k}": v for k, v in decoder.state_dict().items()}
    ae = {"network": "autoencoder", "encoder": encoder_sizes.model_dump(), "decoder": decoder_sizes.model_dump()}
    _write(folder / "ae", both, {**ae, "window": 64, "points": 32}, trained_on)
    digest = open_artefact(folder / "ae").manifest.digest
    lms = {"network": "synthesiser", "synthesiser": synthesiser_sizes.model_dump(), "encoder_digest": digest}
    _write(
        folder / "lms",
        synthesiser.state_dict(),
        {**lms, "window": 64, "points": 32, "longest_gap": 32},
        trained_on,
    )
    return folder


def _write(path: Path, weights: dict, config: dict, data: TrainingData | None) -> None:
    arrays = {name: value.numpy() for name, value in weights.items()}
    with write_artefact(path, "checkpoint", stage="test", config={}, licences=["test only"]) as draft:
        write_checkpoint(
            draft.folder, weights=arrays, config=config, optimiser=None, log=[], card="random",
            trainings=[Training(steps=0, minutes=0.0, data=data)],
        )  # fmt: skip
