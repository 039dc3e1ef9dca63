"""The draws of a step of the denoiser's training: windows of any rig, their noise, and clouds of both."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from stages.shared.training.task import HELD_BACK_SEED, RowRandom, step_random
from stages.shared.training.windows import WindowPool, clouds_of, draw_clouds, known_centre
from stages.train.denoiser.config import Config
from stages.train.denoiser.noisy_windows import noisy_windows

_HELD_BACK = 24  # windows to validate on, of each noise


@dataclass
class NoisyBatch:
    """points and start (B, T, P, 3) metres: the same points on the clean and on the noisy (or mended) windows. groups
    (B, P), valid (B, T); `step` and `rows` name the draw."""

    points: Tensor
    start: Tensor
    groups: Tensor
    valid: Tensor
    step: int = -1
    rows: tuple[int, ...] = ()


class NoisyDrawer:
    """Draws windows of all rigs of a pool with noise."""

    def __init__(self, config: Config, pool: WindowPool):
        self.config, self.pool = config, pool

    def draw(self, rng: RowRandom) -> NoisyBatch:
        noises = [self.config.noises[int(row.integers(len(self.config.noises)))] for row in rng.rows]
        return self.batch(rng, noises, augment=self.config.augment)

    def batch(self, rng: RowRandom, noises: list[str], *, augment: bool) -> NoisyBatch:
        """A batch of `len(rng.rows)` windows, one for each of the noises."""
        config = self.config
        windows = self.pool.draw(len(rng.rows), config.window, rng, augment=augment, proportions=config.proportions)
        noisy = noisy_windows(windows, noises, rng.rows, mended=config.start == "mended")
        sigma = (config.sigma_min_m, config.sigma_max_m)
        cloud = draw_clouds(windows, config.points, sigma, rng, augment=augment, even=True)
        centre = known_centre(noisy[0], windows.valid)
        points = clouds_of(windows.heads, windows.rotations, cloud, centre)
        return NoisyBatch(
            points, clouds_of(*noisy, cloud, centre), cloud.drawn.groups, windows.valid, rng.step, rng.numbers
        )


def held_back_batches(config: Config, pool: WindowPool) -> dict[str, NoisyBatch]:
    """The same held-back windows under every noise."""
    drawer = NoisyDrawer(config, pool)
    return {
        noise: drawer.batch(
            step_random(HELD_BACK_SEED, 13, 0, range(_HELD_BACK)), [noise] * _HELD_BACK, augment=False
        )
        for noise in config.noises
    }
