"""The training of an adaptation: the training of the synthesiser, from given weights, on the user's clips."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from data_schemas.artefact import write_artefact
from data_schemas.checkpoint import Checkpoint
from data_schemas.clips import ClipRow
from data_schemas.tpc import TpcReader, TpcWriter
from stages.shared.inference.models import Models
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.kinematics.forward_numpy import positions_of
from stages.shared.networks.layers.device import choose_device
from stages.shared.pointcloud.bones import bone_set
from stages.shared.progress import Progress
from stages.shared.synthesiser_training.config import SynthesiserTrainingConfig
from stages.shared.synthesiser_training.task import SynthesiserTask
from stages.shared.training.loop import Trained, train
from stages.shared.training.stage import window_pools
from stages.shared.weights.shipped import parts_of, weights_folder
from stages.weights.adapt.clips import Clip
from stages.weights.adapt.config import Config
from stages.weights.adapt.holding_out import Part

_HELD_BACK = (24,)  # windows of a validation


def write_clouds(path: Path, clips: Sequence[Clip], parts: Sequence[Part], points: int, seed: int) -> list[ClipRow]:
    """Write a tpc artefact of the clips' parts, those that are held out in the split `val`. Returns its rows."""
    rows = []
    settings = {"points": points, "seed": seed}
    with (
        write_artefact(path, "tpc", stage="weights-adapt", config=settings) as draft,
        TpcWriter(draft.folder) as writer,
    ):
        for part in parts:
            clip = clips[part.clip]
            bones, joints = bone_set(clip.skeleton, points, seed)
            motion = clip.motion.at(slice(part.start, part.stop))
            row = ClipRow(
                clip=f"{clip.name}.{part.clip}.{part.start}",
                source=clip.source,
                sha256=clip.sha256,
                skeleton=writer.add_bones(bones),
                frames=motion.frames,
                fps=MODEL_FPS,
                seconds=motion.frames / MODEL_FPS,
                split="val" if part.held_out else "train",
                licence=clip.licence,
            )
            writer.add_rigid(row, positions_of(clip.skeleton, motion)[:, joints], motion.rotations[:, joints])
            rows.append(row)
        draft.licences |= {row.licence for row in rows}
    return rows


def training_config(config: Config, folder: Path, models: Models, start: Checkpoint) -> SynthesiserTrainingConfig:
    """Settings of the training, on the clouds in `folder`/tpc: those of `pumps train lms`, for few windows and little
    time."""
    ae, lms = parts_of(weights_folder(config.weights))
    settings = dict(
        output=folder / "train-lms",
        tpc=folder / "tpc",
        ae=ae,
        initial=lms,
        device=config.device,
        seed=config.seed,
        **({"steps": config.steps} if config.steps else {"minutes": config.minutes}),
        batch=config.batch,
        window=models.window,
        points=int(start.config["points"]),
        longest_gap=models.longest_gap,
        synthesiser=models.synthesiser.sizes.model_dump(),
        optimiser="muon",
        learning_rate=config.learning_rate,
        warmup=30,
        cooldown=0.4,
        average=0.99,
        proportions=1.15,
        recorded_share=0.5,
        balance=1.0,
        reuse=4,
        kept_windows=2048,
        validate_every=config.validate_every,
        checkpoint_every=config.validate_every,
    )
    return SynthesiserTrainingConfig.model_validate(settings)


def train_on(settings: SynthesiserTrainingConfig, models: Models, progress: Progress) -> Trained:
    """Train, or go on with a training that was interrupted."""
    with TpcReader(settings.tpc) as reader:
        device = choose_device(settings.device)
        pool, held_back = window_pools(reader, settings, device)
        task = SynthesiserTask(settings, models.autoencoder, pool, held_back, device, _HELD_BACK)
        return train(task, settings, progress=progress)


def halved(weights: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Weights as they are after they were stored in half precision."""
    return {name: value.astype(np.float16).astype(np.float32) for name, value in weights.items()}


def mean_of(start: Checkpoint, trained: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The mean of the weights at the start and at the end of a training."""
    return {name: (start.weights[name].astype(np.float32) + value) / 2 for name, value in trained.items()}
