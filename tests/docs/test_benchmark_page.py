"""The method on docs/benchmark.md is short, trains, fills and changes no key."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
import torch

from stages.shared.inference.pose_filling import load_interpolator
from stages.shared.networks.inbetween.methods import METHODS
from stages.shared.networks.layers.sizes import MethodSizes
from stages.train.baseline.config import Config
from stages.train.baseline.run import run
from tests.shared.training.tiny_clouds import TAILS, swinging, write_clouds

PAGE = Path(__file__).parents[2] / "docs" / "benchmark.md"


@pytest.fixture
def method(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """The page's code as a module of a package of its own, known by its name."""
    code = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.S)[0]
    assert code.count("\n") < 60
    (tmp_path / "both_ways_of_the_page.py").write_text(code)
    monkeypatch.syspath_prepend(str(tmp_path))
    import_module("both_ways_of_the_page")
    monkeypatch.setitem(METHODS, "both-ways", "both_ways_of_the_page:BothWays")
    yield "both-ways"
    sys.modules.pop("both_ways_of_the_page")


def test_the_method_of_the_page_trains_and_fills(method: str, tmp_path: Path) -> None:
    write_clouds(tmp_path / "tpc")
    report = run(
        Config(
            tpc=tmp_path / "tpc", output=tmp_path / "made", method=method, steps=12, batch=4, window=31, warmup=2,
            learning_rate=5e-3, validate_every=12, device="cpu", network=MethodSizes(width=16, layers=1, heads=1),
        )
    )  # fmt: skip
    assert report.figures["val"]["score"] < 1.1
    heads, rotations = (torch.from_numpy(part)[None] for part in swinging(np.random.default_rng(0), 31))
    known = (torch.arange(31) % 10 == 0)[None]
    made = load_interpolator(tmp_path / "made").fill(heads, rotations, torch.from_numpy(TAILS)[None], known)
    assert (made[0][known] == heads[known]).all() and (made[1][known] == rotations[known]).all()
    assert torch.isfinite(made[0]).all()


def test_the_page_lists_the_methods() -> None:
    listed = re.findall(r"^\| `([a-z-]+)` \|", PAGE.read_text(encoding="utf-8"), re.M)
    assert listed == list(METHODS)
