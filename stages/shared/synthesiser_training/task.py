"""Training the latent motion synthesiser with a frozen encoder (PUMPS 3.3): batches, loss, validation.

Latents are encoded from newly drawn points of augmented windows, since a small synthesiser needs varied data most,
and are used in `reuse` steps. The synthesiser learns a residual on the latents of the skeleton's plain interpolation
of the keys (`SynthesiserSizes.base`), encoded from the same points, so that errors that the autoencoder makes in both
cancel.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from stages.shared.inference.models import Autoencoder
from stages.shared.networks.layers.device import precision
from stages.shared.networks.pumps.synthesiser import LatentSynthesiser
from stages.shared.synthesiser_training.config import SynthesiserTrainingConfig
from stages.shared.synthesiser_training.drawing import HELD_BACK, EncodingDrawer, FillDrawer, held_back_batches
from stages.shared.synthesiser_training.encoding import WindowEncoder
from stages.shared.synthesiser_training.fill_batch import FillBatch, KeptBatch
from stages.shared.synthesiser_training.kept_windows import KeptWindows, LatentBatch, Schedule
from stages.shared.training.frozen_autoencoder import latent_errors, latent_loss, mean_squares
from stages.shared.training.task import Drawer, TrainingTask
from stages.shared.training.unfinished import Unfinished
from stages.shared.training.windows import WindowPool


class SynthesiserTask(TrainingTask[LatentSynthesiser]):
    """Training the synthesiser behind a frozen autoencoder."""

    def __init__(
        self,
        config: SynthesiserTrainingConfig,
        autoencoder: Autoencoder,
        pool: WindowPool,
        held_back: WindowPool,
        device: torch.device,
        held_back_parts: Sequence[int] = HELD_BACK,
    ):
        self.config, self.device = config, device
        self.frozen = WindowEncoder(config, autoencoder, device)
        torch.manual_seed(config.seed)
        self.networks = LatentSynthesiser(autoencoder.encoder.latent_width, config.synthesiser).to(device)
        self.held_back = held_back_batches(config, held_back, held_back_parts)
        self.encoded_back: list[LatentBatch] = []
        self.schedule = Schedule(config.reuse, max(1, config.kept_windows // config.batch), config.seed)
        unfinished = Unfinished(config)
        self.kept = KeptWindows(unfinished.folder / "windows" / unfinished.digest)
        self._drawer = FillDrawer(config, pool, self.schedule)

    def drawer(self, *, elsewhere: bool = False) -> Drawer:
        encodes = elsewhere and self.config.reuse > 1 and self.device.type == "cpu"
        return EncodingDrawer(self._drawer, self.kept) if encodes else self._drawer

    def splits(self) -> bool:
        return True

    def weight(self, batch: FillBatch | KeptBatch, rows: int) -> float:
        """The loss is a mean over missing frames."""
        held = self._latents_of(batch) if isinstance(batch, KeptBatch) else batch
        return float((held.valid & ~held.known).sum())

    def _latents_of(self, batch: FillBatch | KeptBatch) -> LatentBatch:
        """A batch's windows, encoded now or at an earlier step."""
        step, rows = batch.step, batch.rows
        if isinstance(batch, FillBatch):
            if self.config.reuse == 1:
                return self.frozen.encode(batch)
            if not self.kept.holds(step, rows):
                self.kept.put(step, rows, self.frozen.encode(batch))
        if self.schedule.draws_afresh(step):
            # Draws that a resumed run needs again are kept too.
            self.kept.forget_before(self.schedule.oldest(max(0, step - self.config.checkpoint_every)))
        steps = [self.schedule.source(step, row) for row in rows]
        for source in sorted(set(steps)):
            if not self.kept.holds(source, rows):
                self.kept.put(source, rows, self.frozen.encode(self._drawer.of_step(source, rows)))
        return self.kept.take(steps, rows).to(self.device)

    def _errors(self, batch: LatentBatch) -> tuple[dict[str, Tensor], dict[str, Tensor]]:
        """Missing frames' mean errors (scalars) of the network and of the base alone: `cloud`, between the clouds
        decoded from the synthesised and from the true latents, metres, and `latent`."""
        known, valid, latents = batch.known, batch.valid, batch.latents
        missing = valid & ~known
        times = torch.arange(known.shape[1], device=self.device).unsqueeze(0)
        with precision(self.device, self.config.mixed_precision):
            base = batch.base_latents, batch.base_centroids
            made = self.networks(latents, batch.centroids, known, times, valid, base)
            clouds = self.frozen.decode(made[0], made[1], batch.groups, batch.identities)
        return (
            latent_errors(mean_squares(clouds, batch.true_clouds), made[0], latents, missing),
            latent_errors(batch.base_squares, batch.base_latents, latents, missing),
        )

    def loss(self, batch: FillBatch | KeptBatch, generator: torch.Generator) -> tuple[Tensor, dict[str, Tensor]]:
        """Root mean square errors of frames; with squares only long gaps would be learnt. The clouds' error is the
        error that a user sees; the latents' error (PUMPS 3.3) also counts features that the decoder does not use."""
        return self.loss_of(self._latents_of(batch))

    def loss_of(self, batch: LatentBatch) -> tuple[Tensor, dict[str, Tensor]]:
        """The loss of encoded windows."""
        made, base = self._errors(batch)
        value = latent_loss(made, self.config.latent_weight)
        return value, {f"{name}_of_base": made[name].detach() / base[name] for name in made}

    def validate(self) -> dict[str, float]:
        """The clouds' and latents' errors as shares of the base's, for keys every 5, 15 and 30 frames and a
        prediction; `score` is the clouds' mean."""
        sums: dict[str, np.ndarray] = {}  # the network's and the base's errors, summed over missing frames
        if not self.encoded_back:
            self.encoded_back = [self.frozen.encode(batch) for _, batch in self.held_back]
        for (name, _), batch in zip(self.held_back, self.encoded_back, strict=True):
            made, base = self._errors(batch)
            count = float((batch.valid & ~batch.known).sum())
            for kind in made:
                here = count * np.array([float(made[kind]), float(base[kind])])
                sums[f"{kind}_of_base_{name}"] = sums.get(f"{kind}_of_base_{name}", 0.0) + here
        shares = {name: float(made / base) for name, (made, base) in sums.items()}
        clouds = [share for name, share in shares.items() if name.startswith("cloud")]
        return {"score": float(np.mean(clouds)), **shares}
