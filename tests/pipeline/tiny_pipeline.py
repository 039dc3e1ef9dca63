"""The settings of the smallest pipeline."""

from __future__ import annotations

from tests.docs.pages import ROOT

CLIPS = ROOT / "stages" / "shared" / "clips"

TRAINING = {
    "steps": 6, "batch": 2, "window": 16, "points": 32, "warmup": 2, "validate_every": 3, "checkpoint_every": 1,
}  # fmt: skip

SETTINGS = {
    **{f"{stage}.{name}": value for stage in ("train-ae", "train-lms") for name, value in TRAINING.items()},
    "train-ae.encoder.width": 8, "train-ae.encoder.heads": 2, "train-ae.decoder.width": 32,
    "train-ae.decoder.heads": 2, "train-ae.decoder.layers": 1, "train-lms.synthesiser.width": 32,
    "train-lms.synthesiser.heads": 2, "train-lms.longest_gap": 12, "data-pick.count": 1, "evaluate.max_windows": 1,
    "evaluate.intervals": [15], "evaluate.transitions": [15], "evaluate.predictions": [15], "evaluate.points": 32,
    "sample-tpc.points": 64, "infill.points": 64, "decode.points": 32,
}  # fmt: skip
