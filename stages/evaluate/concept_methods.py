"""Motion concepts, measured beside the other methods: transitions between keys, and fills that they refine."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from data_schemas.errors import InputError
from data_schemas.motion import MotionReader
from data_schemas.skeleton import Motion
from stages.evaluate.config import Config
from stages.evaluate.measured_clips import WindowBatch
from stages.evaluate.one_checkpoint import OneCheckpoint
from stages.shared.concepts.actions import action_of
from stages.shared.inference.concept_filling import concept_fill
from stages.shared.inference.filling import FillOptions
from stages.shared.inference.refined_motion import refined_motion
from stages.shared.inference.refining import ConceptModel, load_concepts
from stages.shared.statistics.window_seeds import window_seed
from stages.shared.statistics.windows import Window


@dataclass(frozen=True)
class LoadedConcepts(OneCheckpoint):
    """Transition concepts as a method that fills (`pumps infill --method concepts`)."""

    model: ConceptModel

    def fill(self, batch: WindowBatch, given: Motion, options: FillOptions) -> Motion:
        """A window filled; `given` holds nothing where frames are missing."""
        return concept_fill(self.model, batch.skeleton, given, batch.known, options=options).motion


@dataclass(frozen=True)
class Refiner:
    """Refines filled windows between their keys. actions: of clips, by name."""

    model: ConceptModel
    actions: Mapping[str, str]
    seed: int

    def refined(self, batch: WindowBatch, window: Window, filled: Motion) -> Motion:
        """The filled window refined; its keys stay. Raises InputError for another rig, or too short a window."""
        seed = window_seed(self.seed, window.clip, window.start) % 2**63
        return refined_motion(
            self.model, batch.skeleton, filled, self.actions[window.clip], None, seed, window.clip, batch.known
        ).motion


def refiner_of(config: Config, reader: MotionReader, windows: Iterable[Window]) -> Refiner | None:
    """What `config.refine` names, for these windows. Raises InputError for a clip of an action that it has not
    learned."""
    if config.refine is None:
        return None
    model = load_concepts(config.refine, config.device)
    actions = {clip: action_of(reader.row(clip)) for clip in dict.fromkeys(window.clip for window in windows)}
    strange = [clip for clip, action in actions.items() if action not in model.actions]
    if strange:
        raise InputError(
            f"{config.refine} has not learned the action of {len(strange)} of {len(actions)} clips, "
            f"{strange[0]} ({actions[strange[0]] or 'none in its name'}) among them.",
            f"Choose clips of {', '.join(model.actions)} with --where.",
        )
    return Refiner(model, actions, int(np.uint32(config.seed)))
