"""A fill computes frames in blocks, so that a long clip takes little memory; the blocks change no byte."""

from __future__ import annotations

from pathlib import Path

import pytest

from stages.infill.config import Config
from stages.infill.run import run
from stages.shared.formats import bvh_write, euler_rows
from stages.shared.inference import filling
from stages.shared.kinematics import frame_blocks
from stages.shared.solve import skeleton_pose

CLIP = Path(__file__).resolve().parents[2] / "stages" / "shared" / "clips" / "walk.bvh"
SIZES = {
    (frame_blocks, "BLOCK_FRAMES"): 7,
    (filling, "_CURVES_AT_ONCE"): 6,
    (skeleton_pose, "_JOINTS_AT_ONCE"): 2,
    (euler_rows, "_FRAMES_AT_ONCE"): 16,
    (bvh_write, "_ROWS_AT_ONCE"): 5,
}


def test_blocks_change_no_byte(weights: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fill(name: str) -> bytes:
        output = tmp_path / name
        settings = {"points": 48, "device": "cpu", "keyframes": "0,9,20,21,22,30,55,80"}
        run(Config.model_validate({"input": CLIP, "output": output, "weights": weights, **settings}))
        return output.read_bytes()

    whole = fill("whole.bvh")
    for (module, name), size in SIZES.items():
        assert getattr(module, name) > size
        monkeypatch.setattr(module, name, size)
    assert fill("blocks.bvh") == whole
