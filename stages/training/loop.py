"""The one training loop: resume, checkpoints, log, validation, early stop, clipping, mixed precision, seeds.

Unfinished work lies in `NAME.partial` as a checkpoint artefact with the optimiser's state, swapped whole, so that a
run killed at any instant goes on from the last one. Every draw follows from (seed, step), so that the resumed run
takes the same steps as an unbroken one.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from data_schemas.artefact import open_artefact, partial_folder, write_artefact
from data_schemas.checkpoint import read_checkpoint, write_checkpoint
from data_schemas.errors import PumpsError
from stages.progress import Progress
from stages.training.config import TrainingConfig
from stages.training.task import Task, step_seed

_DRAW, _NETWORK = 1, 2  # purposes of the generators
_PROGRESS_ONLY = ("max_time", "output", "tensorboard", "device")  # may differ when a run is resumed


@dataclass
class TrainingState:
    """What a resumed run needs besides the config."""

    step: int = 0
    best: float = float("inf")
    stale: int = 0
    seconds: float = 0.0
    log: list[dict[str, Any]] = field(default_factory=list)


@dataclass
class Trained:
    """The result: averaged weights of the best validation, the log, and whether training has come to its end."""

    weights: dict[str, np.ndarray]
    log: list[dict[str, Any]]
    finished: bool
    step: int
    seconds: float
    best: float


def learning_rate(config: TrainingConfig, step: int) -> float:
    """Linear warm-up, inverse-square-root decay, then a straight way to zero over the last `cooldown` share."""
    rate = config.learning_rate * min((step + 1) / max(1, config.warmup), (max(1, config.warmup) / (step + 1)) ** 0.5)
    left = (config.steps - step) / max(1.0, config.cooldown * config.steps)
    return rate * min(1.0, left)


def train(task: Task, config: TrainingConfig, *, progress: Progress) -> Trained:
    """Train until the steps are done, patience or `max_time` is over.

    Raises: PumpsError where the loss stops being a number.
    """
    return _Run(task, config, progress).go()


class _Run:
    def __init__(self, task: Task, config: TrainingConfig, progress: Progress):
        self.task, self.config, self.progress = task, config, progress
        self.partial = partial_folder(config.output)
        self.named = dict(task.networks.named_parameters())
        self.optimiser = torch.optim.AdamW(
            self.named.values(), lr=config.learning_rate, betas=(0.9, 0.98), weight_decay=config.weight_decay
        )
        self.average = {name: value.detach().clone() for name, value in task.networks.state_dict().items()}
        self.state = TrainingState()
        self.best_weights: dict[str, Tensor] = {}

    def go(self) -> Trained:
        self._resume()
        config, state = self.config, self.state
        began = time.monotonic() - state.seconds
        deadline = time.monotonic() + config.max_time * 60 if config.max_time else float("inf")
        writer = _tensorboard(config)
        self.progress.start(f"training {config.output.name}", config.steps)
        self.progress.advance(state.step)
        figures: dict[str, float] = {}
        stopped = False
        for batch in self._batches(state.step):
            figures = self._step(batch)
            state.step += 1
            state.seconds = time.monotonic() - began
            self.progress.advance(1, " ".join(f"{name} {value:.4g}" for name, value in list(figures.items())[:2]))
            if state.step % 20 == 0 or state.step == config.steps:
                state.log.append({"step": state.step, "seconds": state.seconds, "split": "train", **figures})
            if state.step % config.validate_every == 0 or state.step == config.steps:
                self._validate(writer)
            early = config.patience > 0 and state.stale >= config.patience
            late = time.monotonic() > deadline
            if early or late or state.step % config.checkpoint_every == 0:
                self._keep()
            if early or late:
                stopped = late and not early
                break
        if writer is not None:
            writer.close()
        weights = self.best_weights or self.average
        arrays = {name: value.detach().cpu().numpy() for name, value in weights.items()}
        return Trained(arrays, state.log, not stopped, state.step, state.seconds, state.best)

    def _step(self, batch: Any) -> dict[str, float]:
        config, step = self.config, self.state.step
        for group in self.optimiser.param_groups:
            group["lr"] = learning_rate(config, step)
        self.task.networks.train()
        seed = int(step_seed(config.seed, _NETWORK, step).integers(2**62))
        generator = torch.Generator(device=next(iter(self.named.values())).device).manual_seed(seed)
        loss, figures = self.task.loss(batch, generator)
        if not bool(torch.isfinite(loss)):
            raise PumpsError(
                f"The loss is {loss.item()} at step {step}.",
                "Lower learning_rate or clip_norm; the last checkpoint is kept and the run resumes from it.",
            )
        self.optimiser.zero_grad(set_to_none=True)
        loss.backward()
        norm = nn.utils.clip_grad_norm_(self.named.values(), config.clip_norm)
        self.optimiser.step()
        self._follow()
        return {
            "loss": loss.item(),
            **figures,
            "gradient_norm": float(norm),
            "learning_rate": learning_rate(config, step),
        }

    def _follow(self) -> None:
        """Move the average after the weights; early steps count fully, so that it starts from no random weights."""
        decay = min(self.config.average, (1 + self.state.step) / (10 + self.state.step))
        with torch.no_grad():
            for name, value in self.task.networks.state_dict().items():
                if value.dtype.is_floating_point and decay > 0:
                    self.average[name].lerp_(value, 1 - decay)
                else:
                    self.average[name].copy_(value)

    def _batches(self, first: int) -> Iterator[Any]:
        """Batches drawn one ahead in a thread, so that drawing costs the step nothing where a core is free."""
        with ThreadPoolExecutor(1) as drawing:
            ahead: Future | None = None
            for step in range(first, self.config.steps):
                batch = (ahead or drawing.submit(self._draw, step)).result()
                ahead = drawing.submit(self._draw, step + 1) if step + 1 < self.config.steps else None
                yield batch

    def _draw(self, step: int) -> Any:
        return self.task.draw(step_seed(self.config.seed, _DRAW, step))

    def _validate(self, writer: Any) -> None:
        state, networks = self.state, self.task.networks
        kept = {name: value.detach().clone() for name, value in networks.state_dict().items()}
        networks.load_state_dict(self.average)
        networks.eval()
        with torch.no_grad():
            figures = self.task.validate()
        networks.load_state_dict(kept)
        state.log.append({"step": state.step, "seconds": state.seconds, "split": "val", **figures})
        value = next(iter(figures.values()))
        if value < state.best:
            state.best, state.stale = value, 0
            self.best_weights = {name: tensor.clone() for name, tensor in self.average.items()}
        else:
            state.stale += 1
        shown = ", ".join(f"{name} {value:.4g}" for name, value in figures.items())
        self.progress.message(f"step {state.step}: {shown}")
        if writer is not None:
            for name, number in figures.items():
                writer.add_scalar(f"val/{name}", number, state.step)

    def _keep(self) -> None:
        """Write the partial checkpoint: weights, average, best and the optimiser's moments."""
        arrays: dict[str, Tensor] = {}
        for name, parameter in self.named.items():
            for key, value in self.optimiser.state.get(parameter, {}).items():
                arrays[f"{key}/{name}"] = torch.as_tensor(value)
        arrays |= {f"average/{name}": value for name, value in self.average.items()}
        arrays |= {f"best/{name}": value for name, value in self.best_weights.items()}
        state = {key: value for key, value in vars(self.state).items() if key != "log"}
        with write_artefact(self.partial, "checkpoint", stage="training", config=self._settings()) as draft:
            write_checkpoint(
                draft.folder,
                weights={name: value.cpu().numpy() for name, value in self.task.networks.state_dict().items()},
                config={"training": self._settings(), "state": state},
                optimiser={name: value.detach().cpu().numpy() for name, value in arrays.items()},
                log=self.state.log,
                card="Unfinished training; `pumps train` resumes from it.\n",
            )

    def _resume(self) -> None:
        if not (self.partial / "manifest.json").exists():
            return
        kept = read_checkpoint(open_artefact(self.partial, "checkpoint"))
        if kept.config["training"] != self._settings() or kept.optimiser is None:
            self.progress.message(f"{self.partial.name} was made with other settings; starting afresh.")
            return
        tensors = {name: torch.from_numpy(np.array(value)) for name, value in kept.optimiser.items()}
        self.task.networks.load_state_dict({name: torch.from_numpy(np.array(v)) for name, v in kept.weights.items()})
        for name, parameter in self.named.items():
            if f"step/{name}" not in tensors:
                continue
            moments = {key: tensors[f"{key}/{name}"] for key in ("step", "exp_avg", "exp_avg_sq")}
            self.optimiser.state[parameter] = {
                key: value if key == "step" else value.to(parameter.device) for key, value in moments.items()
            }
        device = next(iter(self.named.values())).device
        self.average = {name: tensors[f"average/{name}"].to(device) for name in self.average}
        self.best_weights = {
            name[5:]: value.to(device) for name, value in tensors.items() if name.startswith("best/")
        }
        self.state = TrainingState(**kept.config["state"], log=list(kept.log))
        self.progress.message(f"going on from step {self.state.step}.")

    def _settings(self) -> dict[str, Any]:
        settings = self.config.model_dump(mode="json")
        return {name: value for name, value in settings.items() if name not in _PROGRESS_ONLY}


def _tensorboard(config: TrainingConfig) -> Any:
    if not config.tensorboard:
        return None
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError as error:
        raise PumpsError(
            "TensorBoard is not installed.", "Install it with: pip install 'pumps[tensorboard]'."
        ) from error
    return SummaryWriter(Path(config.output).with_name(config.output.name + ".tensorboard"))
