"""Training the latent motion synthesiser with a frozen encoder (PUMPS 3.3): batches, loss, validation.

Latents are encoded from freshly drawn points of augmented windows, and serve in `reuse` steps: breadth is what a
small synthesiser lacks first. What it learns is a residual on the latents of the skeleton's own plain interpolation
of the keys (`SynthesiserSizes.base`), encoded from the same points, so that what the autoencoder gets wrong in both
cancels.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from stages.shared.inference.models import Autoencoder, load_autoencoder
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.kinematics.device import onto
from stages.shared.kinematics.plain_interpolation import Glide
from stages.shared.kinematics.window_interpolation import interpolate_windows
from stages.shared.networks.layers.device import precision
from stages.shared.networks.pumps.synthesiser import LatentSynthesiser, interpolate_known
from stages.shared.training.batches import DRAW
from stages.shared.training.masks import draw_known
from stages.shared.training.task import HELD_BACK_SEED, RowRandom, step_generator, step_random, step_seed
from stages.shared.training.unfinished import Unfinished
from stages.shared.training.windows import WindowPool, Windows, clouds_of, draw_clouds, known_centre
from stages.train.lms.config import Config
from stages.train.lms.kept_windows import KeptWindows, LatentBatch, Schedule

_LEAST_M = 0.005  # a cloud this near to the truth pulls no more
_LEAST_LATENT = 0.1
_IDENTITIES = 7  # the purpose of the generators
# Clouds encoded in one call: a GPU wants much work at once, a CPU what stays in its caches.
_FRAMES_AT_ONCE = {"cuda": 32768}
_FRAMES_AT_ONCE_CPU = 4096
# Windows to validate on, in parts; with 32 in all, noise of a hundredth chose the best step.
_HELD_BACK = (32, 32, 32)
_UNIT_M = 0.05  # clouds' distances are learnt in units of this, which makes them about as large as the latents'


@dataclass
class FillBatch:
    """points and base (B, T, P, 3) metres, groups (B, P), known and valid (B, T); `step` and `rows` name the draw."""

    points: Tensor
    base: Tensor | None
    groups: Tensor
    known: Tensor
    valid: Tensor
    step: int = -1
    rows: tuple[int, ...] = ()


@dataclass
class KeptBatch:
    """Rows of a batch whose windows are kept, encoded: drawn at earlier steps, or by the process that draws ahead."""

    step: int
    rows: tuple[int, ...]


class SynthesiserTask:
    """A `Task` of the training loop."""

    splits = True

    def __init__(
        self, config: Config, autoencoder: Autoencoder, pool: WindowPool, held_back: WindowPool, device: torch.device
    ):
        self.config, self.pool, self.device = config, pool, device
        self.encoder = autoencoder.encoder.to(device).eval().requires_grad_(False)
        self.decoder = autoencoder.decoder.to(device).eval().requires_grad_(False)
        self.decoded_frames = autoencoder.window
        torch.manual_seed(config.seed)
        self.networks = LatentSynthesiser(self.encoder.latent_width, config.synthesiser).to(device)
        self.held_back = self._validation(held_back)
        self.encoded_back: list[LatentBatch] = []
        self.schedule = Schedule(config.reuse, max(1, config.kept_windows // config.batch), config.seed)
        unfinished = Unfinished(config)
        self.kept = KeptWindows(unfinished.folder / "windows" / unfinished.digest)

    def weight(self, batch: FillBatch | KeptBatch) -> float:
        """The loss is a mean over missing frames."""
        held = self._latents_of(batch) if isinstance(batch, KeptBatch) else batch
        return float((held.valid & ~held.known).sum())

    def draw(self, rng: RowRandom) -> FillBatch | KeptBatch:
        """On a CPU a drawing process encodes what it draws, too: most of the work, done beside the steps."""
        if self.schedule.draws_afresh(rng.step):
            if self.config.reuse == 1 or not self._far_from_networks or self.device.type != "cpu":
                return self._drawn(rng)
            self._keep_drawn(rng.step, rng.numbers)
        return KeptBatch(rng.step, rng.numbers)

    @property
    def _far_from_networks(self) -> bool:
        """Whether this is the copy in a drawing process."""
        return not hasattr(self, "networks")

    def _keep_drawn(self, step: int, rows: tuple[int, ...]) -> None:
        """Draw, encode and keep what rows draw at a step, but where it is kept."""
        if self.kept.holds(step, rows):
            return
        if self._far_from_networks and not hasattr(self, "encoder"):
            own = load_autoencoder(self.config.ae, "cpu")
            self.encoder, self.decoder = own.encoder.eval(), own.decoder.eval()
        self.kept.put(step, rows, self._encode_batch(self._drawn(step_random(self.config.seed, DRAW, step, rows))))

    def _drawn(self, rng: RowRandom) -> FillBatch:
        config = self.config
        # Each window's own chance, not a turn of the steps: `reuse` draws afresh at some steps alone.
        as_recorded = np.array([row.random() < config.recorded_share for row in rng.rows])
        windows = self.pool.draw(
            len(rng.rows),
            config.window,
            rng,
            augment=config.augment,
            proportions=config.proportions,
            as_recorded=as_recorded,
        )
        known = draw_known(windows.valid.sum(1), config.window, config.longest_gap, rng)
        batch = self._clouds(windows, known, rng, augment=config.augment, as_recorded=as_recorded)
        return replace(batch, step=rng.step, rows=rng.numbers)

    def _validation(self, pool: WindowPool) -> list[tuple[str, FillBatch]]:
        """The same held-back windows with keys every 5, 15 and 30 frames, and a prediction."""
        config, batches = self.config, []
        frames = torch.arange(config.window)
        for part, count in enumerate(_HELD_BACK):
            windows = pool.draw(count, config.window, step_seed(HELD_BACK_SEED, 5, part), augment=False)
            lengths = windows.valid.sum(1, keepdim=True)
            known = {str(every): (frames % every == 0) | (frames == lengths - 1) for every in (5, 15, 30)}
            known["predict"] = frames < (lengths - 15).clamp_min(1)
            for number, (name, each) in enumerate(known.items()):
                random = step_seed(HELD_BACK_SEED, 6, part * len(known) + number)
                batches.append((name, self._clouds(windows, each & windows.valid, random, augment=False)))
        return batches

    def _clouds(
        self,
        windows: Windows,
        known: Tensor,
        rng: np.random.Generator,
        *,
        augment: bool,
        as_recorded: np.ndarray | None = None,
    ) -> FillBatch:
        config = self.config
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
        return FillBatch(points, base, cloud.groups, known, windows.valid)

    def _encode(self, points: Tensor, groups: Tensor) -> tuple[Tensor, Tensor]:
        """points (N, P, 3), groups (N, P) -> latents, centroids; no gradient."""
        with torch.no_grad(), precision(self.device, self.config.mixed_precision):
            count = _FRAMES_AT_ONCE.get(self.device.type, _FRAMES_AT_ONCE_CPU)
            parts = [self.encoder(*part) for part in zip(points.split(count), groups.split(count), strict=True)]
        return torch.cat([latents for latents, _ in parts]), torch.cat([centroids for _, centroids in parts])

    def _encode_into(self, latents: Tensor, centroids: Tensor, points: Tensor, groups: Tensor, rows: Tensor) -> None:
        """Encode frames `rows` (N,), counted over all windows, of points (B, T, P, 3); write the results into latents
        (B, T, D) and centroids (B, T, 3)."""
        clouds = onto(points, self.device).flatten(0, 1)[rows]
        found = self._encode(clouds, groups[rows])
        for whole, part in zip((latents, centroids), found, strict=True):
            whole.flatten(0, 1)[rows] = part

    def _decode(self, latents: Tensor, centroids: Tensor, groups: Tensor, noise: Tensor) -> Tensor:
        """Clouds (B, T, P, 3) of latents (B, T, D), in pieces as long as the decoder was trained on."""
        batch, frames, _ = latents.shape
        length = min(self.decoded_frames, frames)
        spare = -frames % length
        pieces = (frames + spare) // length
        latents, centroids = (
            functional.pad(part, (0, 0, 0, spare)).view(batch * pieces, length, -1) for part in (latents, centroids)
        )
        times = torch.arange(float(length), device=latents.device).unsqueeze(0)
        groups, noise = groups.repeat_interleave(pieces, 0), noise.repeat_interleave(pieces, 0)
        made = self.decoder(latents, centroids, times, groups, noise)
        return made.view(batch, pieces * length, -1, 3)[:, :frames]

    def _encode_batch(self, batch: FillBatch) -> LatentBatch:
        device = self.device
        # Which frames to encode is known on the CPU: asking a GPU would wait for it.
        valid_rows, missing_rows = (
            onto(mask.flatten().nonzero().squeeze(1), device) for mask in (batch.valid, batch.valid & ~batch.known)
        )
        known, valid, point_groups = (onto(part, device) for part in (batch.known, batch.valid, batch.groups))
        frames = known.shape[1]
        groups = point_groups.repeat_interleave(frames, 0)
        latents = torch.zeros(*known.shape, self.encoder.latent_width, device=device)
        centroids = torch.zeros(*known.shape, 3, device=device)
        self._encode_into(latents, centroids, batch.points, groups, valid_rows)
        if batch.base is None:
            every = torch.arange(frames, device=device).expand_as(known)
            base = interpolate_known(latents, known, every), interpolate_known(centroids, known, every)
        else:
            # The base equals the truth at the keys, so only the missing frames of it are encoded.
            base = latents.clone(), centroids.clone()
            self._encode_into(*base, batch.base, groups, missing_rows)
        identities = self.decoder.draw_noise(len(known), point_groups.shape[1], self._identity_random(batch))
        with torch.no_grad(), precision(device, self.config.mixed_precision):
            true_clouds = self._decode(latents, centroids, point_groups, identities)
            plain = self._decode(base[0], base[1], point_groups, identities)
        return LatentBatch(
            latents, centroids, *base, point_groups, known, valid,
            identities, true_clouds, _mean_squares(plain, true_clouds),
        )  # fmt: skip

    def _identity_random(self, batch: FillBatch) -> torch.Generator:
        """Of the decoded points' identities; a window keeps them for its round, so that the truth is decoded once."""
        if batch.step < 0:
            return torch.Generator(device=self.device).manual_seed(0)
        return step_generator(self.config.seed, _IDENTITIES, batch.step, batch.rows, self.device)

    def _latents_of(self, batch: FillBatch | KeptBatch) -> LatentBatch:
        """A batch's windows, encoded now or at an earlier step."""
        step, rows = batch.step, batch.rows
        if isinstance(batch, FillBatch):
            if self.config.reuse == 1:
                return self._encode_batch(batch)
            if not self.kept.holds(step, rows):
                self.kept.put(step, rows, self._encode_batch(batch))
        if self.schedule.draws_afresh(step):
            # What a resumed run needs again is kept, too.
            self.kept.forget_before(self.schedule.oldest(max(0, step - self.config.checkpoint_every)))
        steps = [self.schedule.source(step, row) for row in rows]
        for source in sorted(set(steps)):
            self._keep_drawn(source, rows)
        return self.kept.take(steps, rows).to(self.device)

    def _errors(self, batch: LatentBatch) -> tuple[dict[str, Tensor], dict[str, Tensor]]:
        """Missing frames' mean errors (scalars) of the network and of the base alone: `cloud`, between the clouds
        decoded from the made and from the true latents, metres, and `latent`."""
        known, valid, latents = batch.known, batch.valid, batch.latents
        missing = valid & ~known
        times = torch.arange(known.shape[1], device=self.device).unsqueeze(0)
        with precision(self.device, self.config.mixed_precision):
            base = batch.base_latents, batch.base_centroids
            made = self.networks(latents, batch.centroids, known, times, valid, base)
            clouds = self._decode(made[0], made[1], batch.groups, batch.identities)
        errors = [
            {
                "cloud": _mean_root(squares, _LEAST_M, missing),
                "latent": _mean_root((guess - latents).square().mean(-1), _LEAST_LATENT, missing),
            }
            for squares, guess in (
                (_mean_squares(clouds, batch.true_clouds), made[0]),
                (batch.base_squares, batch.base_latents),
            )
        ]
        return errors[0], errors[1]

    def loss(self, batch: FillBatch | KeptBatch, generator: torch.Generator) -> tuple[Tensor, dict[str, Tensor]]:
        """Frames' root mean square errors, not squares, which would learn long gaps alone. The clouds' error is the
        one that a user sees; the latents' own (PUMPS 3.3) also asks for what the decoder does not look at."""
        made, base = self._errors(self._latents_of(batch))
        value = made["cloud"] / _UNIT_M + self.config.latent_weight * made["latent"]
        return value, {f"{name}_of_base": made[name].detach() / base[name] for name in made}

    def validate(self) -> dict[str, float]:
        """The clouds' and latents' errors as shares of the base's, for keys every 5, 15 and 30 frames and a
        prediction; `score` is the clouds' mean."""
        sums: dict[str, np.ndarray] = {}  # the network's and the base's errors, summed over missing frames
        if not self.encoded_back:
            self.encoded_back = [self._encode_batch(batch) for _, batch in self.held_back]
        for (name, _), batch in zip(self.held_back, self.encoded_back, strict=True):
            made, base = self._errors(batch)
            count = float((batch.valid & ~batch.known).sum())
            for kind in made:
                here = count * np.array([float(made[kind]), float(base[kind])])
                sums[f"{kind}_of_base_{name}"] = sums.get(f"{kind}_of_base_{name}", 0.0) + here
        shares = {name: float(made / base) for name, (made, base) in sums.items()}
        clouds = [share for name, share in shares.items() if name.startswith("cloud")]
        return {"score": float(np.mean(clouds)), **shares}


def _mean_squares(clouds: Tensor, others: Tensor) -> Tensor:
    """Mean over points of squared distances, (B, T) square metres, of clouds (B, T, P, 3)."""
    return (clouds - others).square().sum(-1).mean(-1)


def _mean_root(square: Tensor, least: float, missing: Tensor) -> Tensor:
    """Mean over missing frames (B, T) of the roots of mean squares (B, T); below `least` the root flattens out."""
    root = (square + least**2).sqrt() - least
    return (root * missing).sum() / missing.sum().clamp_min(1)
