"""The draws of a step of the synthesiser's training: windows, known frames, clouds and their base."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from stages.shared.inference.models import load_autoencoder
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.kinematics.plain_interpolation import Glide
from stages.shared.kinematics.window_interpolation import interpolate_windows
from stages.shared.synthesiser_training.config import SynthesiserTrainingConfig
from stages.shared.synthesiser_training.encoding import WindowEncoder
from stages.shared.synthesiser_training.fill_batch import FillBatch, KeptBatch
from stages.shared.synthesiser_training.kept_windows import KeptWindows, Schedule
from stages.shared.training.batches import DRAW
from stages.shared.training.masks import draw_known
from stages.shared.training.task import HELD_BACK_SEED, RowRandom, step_random, step_seed
from stages.shared.training.windows import WindowPool, Windows, clouds_of, draw_clouds, known_centre

# Windows to validate on, in parts; with only 32, noise of a hundredth decided the best step.
HELD_BACK = (32, 32, 32)


class FillDrawer:
    """Draws the steps' windows. Steps that draw none name the rows that use kept windows."""

    def __init__(self, config: SynthesiserTrainingConfig, pool: WindowPool, schedule: Schedule):
        self.config, self.pool, self.schedule = config, pool, schedule

    def draw(self, rng: RowRandom) -> FillBatch | KeptBatch:
        return self.fresh(rng) if self.schedule.draws_afresh(rng.step) else KeptBatch(rng.step, rng.numbers)

    def of_step(self, step: int, rows: tuple[int, ...]) -> FillBatch:
        """What rows draw at a step."""
        return self.fresh(step_random(self.config.seed, DRAW, step, rows))

    def fresh(self, rng: RowRandom) -> FillBatch:
        """Windows of this step, drawn now."""
        config = self.config
        # Decided for each window, not by the number of the step, since with `reuse` only some steps draw.
        as_recorded = np.array([row.random() < config.recorded_share for row in rng.rows])
        windows = self.pool.draw(
            len(rng.rows),
            config.window,
            rng,
            augment=config.augment,
            proportions=config.proportions,
            as_recorded=as_recorded,
            borrowed_share=config.borrowed_share if config.augment else 0.0,
        )
        known = draw_known(windows.valid.sum(1), config.window, config.longest_gap, rng)
        batch = clouds_with_base(config, windows, known, rng, augment=config.augment, as_recorded=as_recorded)
        return replace(batch, step=rng.step, rows=rng.numbers)


class EncodingDrawer:
    """Draws in a process of its own, on a CPU: it encodes the windows that it draws and keeps them on the disk. This
    is most of the work, and runs in parallel with the steps. Pickle it before the first draw, which loads the
    encoder."""

    def __init__(self, drawer: FillDrawer, kept: KeptWindows):
        self.drawer, self.kept = drawer, kept
        self._encoder: WindowEncoder | None = None

    def draw(self, rng: RowRandom) -> KeptBatch:
        step, rows = rng.step, rng.numbers
        if self.drawer.schedule.draws_afresh(step) and not self.kept.holds(step, rows):
            if self._encoder is None:
                config, cpu = self.drawer.config, torch.device("cpu")
                self._encoder = WindowEncoder(config, load_autoencoder(config.ae, "cpu"), cpu)
            self.kept.put(step, rows, self._encoder.encode(self.drawer.of_step(step, rows)))
        return KeptBatch(step, rows)


def held_back_batches(
    config: SynthesiserTrainingConfig, pool: WindowPool, parts: Sequence[int] = HELD_BACK
) -> list[tuple[str, FillBatch]]:
    """The same held-back windows, so many in each part, with keys every 5, 15 and 30 frames, and a prediction."""
    batches = []
    frames = torch.arange(config.window)
    for part, count in enumerate(parts):
        windows = pool.draw(count, config.window, step_seed(HELD_BACK_SEED, 5, part), augment=False)
        lengths = windows.valid.sum(1, keepdim=True)
        known = {str(every): (frames % every == 0) | (frames == lengths - 1) for every in (5, 15, 30)}
        known["predict"] = frames < (lengths - 15).clamp_min(1)
        for number, (name, each) in enumerate(known.items()):
            random = step_seed(HELD_BACK_SEED, 6, part * len(known) + number)
            batches.append((name, clouds_with_base(config, windows, each & windows.valid, random, augment=False)))
    return batches


def clouds_with_base(
    config: SynthesiserTrainingConfig,
    windows: Windows,
    known: Tensor,
    rng: np.random.Generator,
    *,
    augment: bool,
    as_recorded: np.ndarray | None = None,
) -> FillBatch:
    """Clouds of windows and, on the same points, of the plain interpolation of their known frames (B, T)."""
    sigma = (config.sigma_min_m, config.sigma_max_m)
    cloud = draw_clouds(
        windows, config.points, sigma, rng, augment=augment, even=config.even, as_recorded=as_recorded
    )
    centre = known_centre(windows.heads, known)
    points = clouds_of(windows.heads, windows.rotations, cloud, centre)
    base = None
    if config.synthesiser.base == "skeleton":
        sizes = config.synthesiser
        plain = interpolate_windows(
            windows.heads,
            windows.rotations,
            windows.parents,
            known,
            rate_hz=MODEL_FPS,
            glide=Glide(sizes.glide_root_s, sizes.glide_turn_s).in_frames(MODEL_FPS),
        )
        base = clouds_of(*plain, cloud, centre)
    return FillBatch(points, base, cloud.drawn.groups, known, windows.valid)
