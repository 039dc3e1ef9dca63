"""Which trainings a checkpoint's weights went through: kept in its config, one after the other."""

from __future__ import annotations

from typing import Any

from data_schemas.checkpoint import Checkpoint


def trainings_of(kept: Checkpoint) -> list[dict[str, Any]]:
    """Steps, minutes and `trained_on` of each; of weights that do not say it, those of the last, as far as told."""
    last = kept.log[-1] if kept.log else {}
    return kept.config.get("trainings") or [
        {
            "steps": last.get("step", 0),
            "minutes": round(last.get("seconds", 0) / 60, 1),
            "trained_on": kept.config.get("trained_on", ""),
        }
    ]


def data_of(kept: Checkpoint) -> list[str]:
    """What weights were trained on, a line for each of their trainings that differs."""
    lines = [str(each.get("trained_on", "")) for each in (kept.config, *trainings_of(kept))]
    return list(dict.fromkeys(line for line in lines if line))
