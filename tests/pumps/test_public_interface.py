"""`import pumps` gives what the commands give, to the byte, and loads no torch by itself."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import pumps
from pumps_cli.app import main
from tests.shared.inference.examples import write_random_weights

ROOT = Path(__file__).resolve().parents[2]
CLIPS = ROOT / "stages" / "shared" / "clips"
PAGE = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def weights(tmp_path_factory) -> Path:
    return write_random_weights(tmp_path_factory.mktemp("weights"))


def _command(*words: str) -> None:
    with pytest.raises(SystemExit) as leaving:
        main(["--quiet", *words] if words[0].startswith("-") else [*words, "--quiet"])
    assert leaving.value.code in (None, 0)


def test_importing_it_loads_no_torch():
    code = "import sys, pumps; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT).returncode == 0


@pytest.mark.parametrize(
    ("options", "arguments"),
    [
        (["--keyframes", "0,15,40"], {"keyframes": [0, 15, 40]}),
        (["--keyframes", "0,15,30"], {"keyframes": range(0, 31, 15)}),
        (["--keyframes", "every:15"], {"keyframes": "every:15"}),
        (["--keyframes", "0,20,40"], {"keyframes": np.array([0, 20, 40])}),
        (["--transition", "30:50"], {"transition": (30, 50)}),
        (["--predict", "10"], {"predict": 10}),
    ],
)
def test_infill_is_the_command_to_the_byte(options, arguments, weights: Path, tmp_path: Path):
    _command("infill", str(CLIPS / "jump.bvh"), *options, "--weights", str(weights), "-o", str(tmp_path / "one.bvh"))
    filled = pumps.infill(pumps.load(CLIPS / "jump.bvh"), weights=weights, **arguments)
    pumps.save(filled, tmp_path / "two.bvh")
    assert (tmp_path / "one.bvh").read_bytes() == (tmp_path / "two.bvh").read_bytes()


def test_retarget_is_the_command_to_the_byte(tmp_path: Path):
    rig = ROOT / "docs" / "examples" / "other_rig.bvh"
    _command("retarget", str(CLIPS / "kick.bvh"), "--to", str(rig), "-o", str(tmp_path / "one.bvh"))
    pumps.save(pumps.retarget(pumps.load(CLIPS / "kick.bvh"), to=pumps.load(rig)), tmp_path / "two.bvh")
    assert (tmp_path / "one.bvh").read_bytes() == (tmp_path / "two.bvh").read_bytes()


@pytest.mark.parametrize("suffix", [".glb", ".npz", ".csv", ".parquet"])
def test_save_is_export_to_the_byte(suffix: str, tmp_path: Path):
    _command("export", str(CLIPS / "walk.bvh"), "-o", str(tmp_path / f"walk{suffix}"))
    (tmp_path / "own").mkdir()
    pumps.save(pumps.load(CLIPS / "walk.bvh"), tmp_path / "own" / f"walk{suffix}")
    assert (tmp_path / f"walk{suffix}").read_bytes() == (tmp_path / "own" / f"walk{suffix}").read_bytes()


def test_a_bvh_comes_back_as_it_was_and_nothing_is_replaced_unasked(tmp_path: Path):
    motion = pumps.load(CLIPS / "walk.bvh")
    pumps.save(motion, tmp_path / "walk.bvh")
    assert (tmp_path / "walk.bvh").read_bytes() == (CLIPS / "walk.bvh").read_bytes()
    with pytest.raises(pumps.UsageError, match="exists"):
        pumps.save(motion, tmp_path / "walk.bvh")
    with pytest.raises(pumps.UsageError, match="suffix"):
        pumps.save(motion, tmp_path / "walk.fbx")


def test_artefacts_give_the_arrays_back(tmp_path: Path):
    motion = pumps.load(CLIPS / "walk.bvh")
    assert pumps.write_clips([motion], tmp_path / "clips", split="test") == 1
    (back,) = pumps.read_clips(tmp_path / "clips")
    assert back.names == motion.names and back.fps == motion.fps
    assert np.array_equal(back.rotations, motion.rotations)
    assert np.abs(back.positions - motion.positions).max() < 1e-6
    with pytest.raises(pumps.UsageError, match="exists"):
        pumps.write_clips([motion], tmp_path / "clips")


def test_arrays_are_read_only():
    motion = pumps.load(CLIPS / "walk.bvh")
    for values in (motion.positions, motion.rotations, motion.local_rotations, motion.offsets, motion.parents):
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 0


@pytest.mark.parametrize("frames", [[], [0.5, 3]])
def test_keyframes_that_are_no_frames_are_refused(frames):
    with pytest.raises(pumps.UsageError, match="whole frame numbers"):
        pumps.infill(pumps.load(CLIPS / "jump.bvh"), keyframes=frames)


def test_the_page_names_all_of_it():
    named = set(re.findall(r"pumps\.(\w+)", PAGE)) | set(re.findall(r"`(\w+)`", PAGE))
    assert set(pumps.__all__) - {"__version__"} <= named
    used = set(re.findall(r"pumps\.(\w+)\(", PAGE))
    assert used <= set(pumps.__all__)


@pytest.mark.parametrize("number", range(len(re.findall(r"^```python\n", PAGE, re.M))))
def test_every_line_of_the_page_runs(number: int, tmp_path: Path):
    code = re.findall(r"^```python\n(.*?)^```", PAGE, re.M | re.S)[number]
    for name in ("stages", "docs"):
        (tmp_path / name).symlink_to(ROOT / name)
    environment = {"PYTHONPATH": str(ROOT), "PATH": "/usr/bin:/bin", "OMP_NUM_THREADS": "1"}
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
