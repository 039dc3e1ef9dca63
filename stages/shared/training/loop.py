"""The training loop of all networks: parts of batches, several processes, validation, checkpoints, log, early stop.

Every draw depends on (seed, step, window) only, so that a resumed run takes the same steps as an uninterrupted one,
and a batch does not depend on the number of processes and parts over which it is split.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from data_schemas.checkpoint import read_checkpoint
from data_schemas.errors import PumpsError, UsageError
from stages.shared.networks.layers.layer_stack import set_checkpointing
from stages.shared.progress import SILENT, Progress
from stages.shared.training.batches import drawn_ahead, parts_of
from stages.shared.training.config import TrainingConfig
from stages.shared.training.log import TrainingLog
from stages.shared.training.optimiser import Optimiser
from stages.shared.training.ranks import Ranks, join_ranks
from stages.shared.training.task import TrainingTask, step_generator
from stages.shared.training.unfinished import Place, Unfinished, arrays_of, set_weights

_NETWORK = 2  # the purpose of the generators
_LOG_EVERY = 20


@dataclass
class Trained:
    """The result: averaged weights of the best validation, the log, and whether the training is finished.

    best: score of the best validation; best_step: its step. optimiser: the state at the end, if kept.
    last: averaged weights of the last step, where the task keeps both.
    """

    weights: dict[str, np.ndarray]
    log: list[dict[str, Any]]
    finished: bool
    step: int
    seconds: float
    best: float
    best_step: int = 0
    optimiser: dict[str, np.ndarray] | None = None
    last: dict[str, np.ndarray] | None = None


def learning_rate(config: TrainingConfig, step: int, seconds: float = 0.0) -> float:
    """Learning rate at a step: linear warm-up, then inverse-square-root decay, then linear decay to zero.

    The last part takes the share `cooldown` of the steps, or of the time where `minutes` end the training.
    """
    rate = config.learning_rate * min((step + 1) / max(1, config.warmup), (max(1, config.warmup) / (step + 1)) ** 0.5)
    if config.last_step is None:
        left = max(0.0, 60 * config.minutes - seconds) / max(1.0, config.cooldown * 60 * config.minutes)
    else:
        left = (config.last_step - step) / max(1.0, config.cooldown * config.last_step)
    return rate * min(1.0, left)


def average_decay(config: TrainingConfig, step: int) -> float:
    """Decay of the moving average at a step; it is small in early steps, so that random initial weights vanish."""
    return min(config.average, (1 + step) / (10 + step))


def train(task: TrainingTask[Any], config: TrainingConfig, *, progress: Progress) -> Trained:
    """Train until the steps are done, or patience or `max_time` runs out; in all processes of the launcher.

    Raises:
        UsageError: a batch cannot be split over the processes and parts.
        InputError: the weights of `initial` do not match the networks.
        PumpsError: the loss is not a finite number.
    """
    device = next(iter(task.networks.parameters())).device
    ranks = join_ranks(device)
    try:
        return _Run(task, config, ranks, progress if ranks.first else SILENT).go()
    finally:
        if ranks.first:
            Unfinished(config).release()


@contextmanager
def _threads_left(workers: int) -> Iterator[None]:
    """Leave one core to each drawing process, since threads that share a core slow each other down."""
    threads = torch.get_num_threads()
    torch.set_num_threads(max(1, threads - workers))
    try:
        yield
    finally:
        torch.set_num_threads(threads)


class _Run:
    def __init__(self, task: TrainingTask[Any], config: TrainingConfig, ranks: Ranks, progress: Progress):
        self.task, self.config, self.ranks, self.progress = task, config, ranks, progress
        self.parts = parts_of(config, ranks, task.splits())
        if config.minutes and ranks.count > 1:
            raise UsageError(
                "A training that is limited by minutes must run in one process.", "Give steps instead of minutes."
            )
        self.named = dict(task.networks.named_parameters())
        self.device = next(iter(self.named.values())).device
        self.optimiser = Optimiser(task.networks, config)
        set_checkpointing(task.networks, config.activation_checkpointing)
        self.unfinished = Unfinished(config)
        if ranks.first:
            self.unfinished.claim()
        self.place = Place()
        self.best_weights: dict[str, Tensor] = {}
        self.bad_step = torch.full((), float("inf"), device=self.device)  # the first step whose loss was not a number
        rows = self._begin()
        self.log = TrainingLog(config, self.unfinished.log_folder, rows) if ranks.first else None

    def go(self) -> Trained:
        config, place = self.config, self.place
        began = time.monotonic() - place.seconds
        deadline = time.monotonic() + config.max_time * 60 if config.max_time else float("inf")
        self._start_bar()
        late = False
        beside = config.workers if self.device.type == "cpu" else 0
        with _threads_left(beside), closing(drawn_ahead(self.task, config, self.parts, place.step)) as batches:
            while not late and not self._done():
                numbers = self._step(batches, time.monotonic() > deadline)
                place.step += 1
                seconds, place.seconds = place.seconds, time.monotonic() - began
                last = self._at_the_end()
                logged = place.step % _LOG_EVERY == 0 or last
                validated = place.step % config.validate_every == 0 or last
                kept = place.step % config.checkpoint_every == 0
                note = ""
                # On a GPU a step runs asynchronously, until its numbers are read.
                if logged or validated or kept or self.device.type == "cpu":
                    figures, late = self._seen(numbers)
                    note = " ".join(f"{name} {value:.4g}" for name, value in list(figures.items())[:2])
                    if logged and self.log is not None:
                        self.log.add("train", place.step, place.seconds, figures)
                self.progress.advance(1 if config.last_step else place.seconds - seconds, note)
                if validated:
                    self._validate()
                if kept or late:
                    self._keep()
        if self.log is not None:
            self.log.close()
        finished = self._done()
        moments = arrays_of(self.optimiser.moments()) if config.keep_optimiser and finished else None
        return Trained(
            arrays_of(self.best_weights or self.average),
            self.log.rows if self.log is not None else [],
            finished,
            place.step,
            place.seconds,
            place.best,
            place.best_step,
            moments,
            arrays_of(self.average) if self.task.keeps_both and finished else None,
        )

    def _start_bar(self) -> None:
        """A bar of steps, or of seconds where minutes end the training."""
        label = f"training {self.config.output.name}"
        if self.config.last_step is None:
            self.progress.start(f"{label}, seconds", 60 * self.config.minutes)
            self.progress.advance(self.place.seconds)
        else:
            self.progress.start(label, self.config.last_step)
            self.progress.advance(self.place.step)

    def _done(self) -> bool:
        return self._at_the_end() or self._stale()

    def _at_the_end(self) -> bool:
        last = self.config.last_step
        return self.place.seconds >= 60 * self.config.minutes if last is None else self.place.step >= last

    def _stale(self) -> bool:
        return 0 < self.config.patience <= self.place.stale

    def _weights(self) -> dict[str, Tensor]:
        return {name: value.detach().clone() for name, value in self.task.networks.state_dict().items()}

    def _step(self, batches: Any, late: bool) -> dict[str, Tensor]:
        """One step of the optimiser. Returns scalar tensors, on the device, that `_seen` reads."""
        config, step, task = self.config, self.place.step, self.task
        own = task.rate(step)
        rate = learning_rate(config, step, self.place.seconds) if own is None else own
        task.networks.train()
        self.optimiser.zero_grad()
        whole = self.ranks.count * len(self.parts) == 1
        names: list[str] = []
        totals: Tensor | None = None
        for part in self.parts:
            batch = next(batches)
            loss, figures = task.loss(batch, step_generator(config.seed, _NETWORK, step, part, self.device))
            weight = 1.0 if whole else task.weight(batch, len(part))
            (loss if whole else loss * weight).backward()
            names = ["loss", *figures]
            values = [self._scalar(each) * weight for each in (loss, *figures.values())]
            here = torch.stack([*values, self._scalar(weight), self._scalar(float(late))])
            totals = here if totals is None else totals + here
        assert totals is not None
        parameters = list(self.named.values())
        totals = self.ranks.sum_gradients(parameters, totals)
        if not whole:
            for parameter in parameters:
                if parameter.grad is not None:
                    parameter.grad /= totals[-2]
        numbers = dict(zip(names, (totals[:-2] / totals[-2]).unbind(), strict=True))
        norm = nn.utils.clip_grad_norm_(parameters, config.clip_norm)
        self.bad_step = torch.where(
            torch.isfinite(numbers["loss"]), self.bad_step, torch.clamp(self.bad_step, max=float(step))
        )
        self.optimiser.step(rate)
        self._follow()
        return {**numbers, "gradient_norm": norm, "learning_rate": torch.tensor(rate), "late": totals[-1]}

    def _scalar(self, value: Any) -> Tensor:
        # Filled in on the device, since copying a number to it would wait for it.
        if isinstance(value, Tensor):
            return value.detach().float().to(self.device)
        return torch.full((), float(value), device=self.device)

    def _seen(self, numbers: dict[str, Tensor]) -> tuple[dict[str, float], bool]:
        """The step's numbers, and whether the time is over. Raises PumpsError if a loss was not a number."""
        bad = float(self.bad_step)
        figures = {name: float(value) for name, value in numbers.items()}
        if bad != float("inf"):
            raise PumpsError(
                f"The loss is {figures['loss']} at step {int(bad)}.",
                "Lower learning_rate or clip_norm; the last checkpoint is kept and the run resumes from it.",
            )
        return figures, figures.pop("late") > 0

    def _follow(self) -> None:
        """Update the moving average of the weights."""
        decay = average_decay(self.config, self.place.step)
        values = self.task.networks.state_dict()
        moving = [name for name, value in values.items() if value.dtype.is_floating_point and decay > 0]
        with torch.no_grad():
            if moving:
                torch._foreach_lerp_(  # pyright: ignore[reportPrivateImportUsage]
                    [self.average[name] for name in moving], [values[name] for name in moving], 1 - decay
                )
            for name in values.keys() - moving:
                self.average[name].copy_(values[name])

    def _validate(self) -> None:
        """Validate the averaged weights, in the first process."""
        place, networks = self.place, self.task.networks
        figures: dict[str, float] = {}
        if self.log is not None:
            kept = self._weights()
            networks.load_state_dict(self.average)
            networks.eval()
            with torch.no_grad():
                figures = self.task.validate()
            networks.load_state_dict(kept)
            self.log.add("val", place.step, place.seconds, figures)
            self.log.save_part()
            shown = ", ".join(f"{name} {value:.4g}" for name, value in figures.items())
            self.progress.message(f"step {place.step}: {shown}")
        score = self.ranks.from_first(next(iter(figures.values()), 0.0))
        if self.task.keeps_last or score < place.best:
            place.best, place.best_step, place.stale = score, place.step, 0
            self.best_weights = {name: tensor.clone() for name, tensor in self.average.items()}
        else:
            place.stale += 1

    def _keep(self) -> None:
        """Write a checkpoint: weights, optimiser's state, averaged weights and best weights."""
        if self.log is None:
            return
        tensors = self.optimiser.moments()
        tensors |= {f"average/{name}": value for name, value in self.average.items()}
        tensors |= {f"best/{name}": value for name, value in self.best_weights.items()}
        self.unfinished.keep(self.place, self.task.networks.state_dict(), tensors, self.log.rows)
        self.log.forget_parts()

    def _begin(self) -> list[dict[str, Any]]:
        """Resume an unfinished run, or start one, from `initial` if given. Returns the rows of the log so far."""
        networks = self.task.networks
        kept = self.ranks.from_first(self.unfinished.newest(self.progress) if self.ranks.first else None)
        if kept is None:
            if self.config.initial is not None:
                self._start_from(self.config.initial)
            self.ranks.copy_weights(networks)
            self.average = self._weights()
            return []
        arrays = kept.optimiser or {}
        set_weights(networks, kept.weights, source=self.unfinished.folder)
        self.optimiser.set_moments(arrays)
        tensors = {name: torch.from_numpy(np.array(value)).to(self.device) for name, value in arrays.items()}
        self.average = {name: tensors[f"average/{name}"] for name in networks.state_dict()}
        self.best_weights = {name[5:]: value for name, value in tensors.items() if name.startswith("best/")}
        self.place = Place(**kept.config["place"])
        self.progress.message(f"going on from step {self.place.step}.")
        return list(kept.log)

    def _start_from(self, initial: Any) -> None:
        source = read_checkpoint(initial)
        fresh = set_weights(self.task.networks, source.weights, source=initial)
        self.optimiser.set_moments(source.optimiser or {})
        state = "with" if source.optimiser else "without"
        new = f"; {len(fresh)} of the weights start fresh, such as {fresh[0]}" if fresh else ""
        self.progress.message(f"starting from {initial}, {state} its optimiser's state{new}.")
