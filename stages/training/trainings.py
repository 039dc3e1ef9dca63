"""Which trainings a checkpoint's weights went through: kept in its config, one after the other."""

from __future__ import annotations

from data_schemas.checkpoint import Checkpoint


def trainings_of(kept: Checkpoint) -> list[dict[str, float]]:
    """Steps and minutes of each; of weights that do not say it, those of the last, which their log tells."""
    last = kept.log[-1] if kept.log else {}
    return kept.config.get("trainings") or [
        {"steps": last.get("step", 0), "minutes": round(last.get("seconds", 0) / 60, 1)}
    ]
