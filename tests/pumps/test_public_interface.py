"""`import pumps` gives what the commands give, to the byte, and loads no torch by itself."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import pumps
from pumps_cli.app import main
from stages.shared.inference import kept_models
from tests.shared.inference.examples import write_random_weights

ROOT = Path(__file__).resolve().parents[2]
CLIPS = ROOT / "stages" / "shared" / "clips"
PAGE = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
README = (ROOT / "README.md").read_text(encoding="utf-8")
EXAMPLES = [
    pytest.param(code, id=f"{name} {number}")
    for name, page in (("python.md", PAGE), ("README.md", README))
    for number, code in enumerate(re.findall(r"^```python\n(.*?)^```", page, re.M | re.S))
]


@pytest.fixture(scope="module")
def weights(tmp_path_factory) -> Path:
    return write_random_weights(tmp_path_factory.mktemp("weights"))


def _command(*words: str) -> None:
    with pytest.raises(SystemExit) as leaving:
        main(["--quiet", *words] if words[0].startswith("-") else [*words, "--quiet"])
    assert leaving.value.code in (None, 0)


def _run(code: str, **environment: str) -> str:
    """What Python code prints in a process of its own, without settings of OpenMP but those given."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("OMP_", "GOMP_", "KMP_"))}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, env={**kept, **environment}, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_importing_it_loads_no_torch():
    assert _run("import sys, pumps; print('torch' in sys.modules)") == "False"


@pytest.mark.parametrize(
    ("imports", "environment", "inside"),
    [
        ("torch, pumps", {}, 1),  # torch's threads spin
        ("pumps, torch", {}, 2),  # they sleep
        ("torch, pumps", {"OMP_WAIT_POLICY": "passive"}, 2),
    ],
)
def test_threads_that_cannot_be_made_to_sleep_are_not_used(imports: str, environment: dict[str, str], inside: int):
    """And the caller's number of threads comes back, whatever happens inside."""
    code = f"""
import {imports}
from stages.infill import run
def seen(*_):
    print(torch.get_num_threads())
    raise pumps.InputError("seen")
torch.set_num_threads(2)
run.fill_files = seen
motion = pumps.load("stages/shared/clips/jump.bvh")
for _ in range(2):
    try: pumps.infill(motion, "every:15")
    except pumps.InputError as error: assert error.message == "seen", error
print(torch.get_num_threads())
"""
    assert _run(code, **environment).split() == [str(inside), str(inside), "2"]


@pytest.mark.parametrize(
    ("options", "arguments"),
    [
        (["--keyframes", "0,15,40"], {"keyframes": [0, 15, 40]}),
        (["--keyframes", "0,15,30"], {"keyframes": range(0, 31, 15)}),
        (["--keyframes", "every:15"], {"keyframes": "every:15"}),
        (["--keyframes", "0,20,40"], {"keyframes": np.array([0, 20, 40])}),
        (["--transition", "30:50"], {"transition": (30, 50)}),
        (["--transition", "30:50"], {"transition": "30:50"}),
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
    with pytest.raises(pumps.UsageError, match="No motions"):
        pumps.write_clips([], tmp_path / "none")


def test_notes_are_sentences(tmp_path: Path):
    header = ",".join(f"{name}.{axis}" for name in pumps.load(CLIPS / "walk.bvh").names for axis in "xyz")
    places = pumps.load(CLIPS / "walk.bvh").positions[:20]
    lines = [header, *(",".join(f"{value:.5f}" for value in frame.ravel()) for frame in places)]
    (tmp_path / "walk.csv").write_text("\n".join(lines))
    motion = pumps.load(tmp_path / "walk.csv", skeleton=CLIPS / "walk.bvh")
    assert motion.notes and all(isinstance(note, str) and note.endswith(".") for note in motion.notes)


def test_arrays_are_read_only():
    motion = pumps.load(CLIPS / "walk.bvh")
    for values in (motion.positions, motion.rotations, motion.local_rotations, motion.offsets, motion.parents):
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 0


@pytest.mark.parametrize(
    ("options", "arguments"),
    [
        (["--frames", "0,15,40,55"], {"frames": np.array([0, 15, 40, 55])}),
        (["--times", "0,0.5,1.3,1.8"], {"times": [0, 0.5, 1.3, 1.8]}),
    ],
)
def test_keys_alone_are_filled_as_by_the_command(options, arguments, weights: Path, tmp_path: Path):
    keys = ROOT / "docs" / "examples" / "jump_keys.bvh"
    _command("infill", str(keys), *options, "--weights", str(weights), "-o", str(tmp_path / "one.bvh"))
    pumps.save(pumps.infill(pumps.load(keys), weights=weights, **arguments), tmp_path / "two.bvh")
    assert (tmp_path / "one.bvh").read_bytes() == (tmp_path / "two.bvh").read_bytes()


@pytest.mark.parametrize(
    "arguments",
    [
        {"keyframes": []},
        {"keyframes": [0.5, 3]},
        {"keyframes": [0, float("nan")]},
        {"keyframes": ["0", "15"]},
        {"keyframes": 15},
        {"keyframes": np.arange(60) % 15 == 0},
        {"keyframes": [[0, 15], [30, 40]]},
        {"transition": (30, 40, 50)},
        {"transition": "30,60"},
        {"frames": [0, 1.5]},
        {"times": ["now"]},
        {"keyframes": [0, 15], "transition": (30, 40)},
        {"keyframes": "every:15", "points": 0},
        {"keyframes": "every:15", "points": "many"},
        {"predict": 2.5},
        {},
    ],
)
def test_frames_that_are_none_are_refused(arguments):
    with pytest.raises(pumps.UsageError):
        pumps.infill(pumps.load(CLIPS / "jump.bvh"), **arguments)


@pytest.mark.parametrize("fps", [0, -30, float("nan")])
def test_a_frame_rate_must_be_one(fps: float):
    with pytest.raises(pumps.UsageError, match="fps"):
        pumps.load(CLIPS / "jump.bvh", fps=fps)


def test_a_mask_is_refused_with_the_way_to_give_it():
    with pytest.raises(pumps.UsageError, match="flatnonzero"):
        pumps.infill(pumps.load(CLIPS / "jump.bvh"), keyframes=np.array([True, False, True]))


def test_weights_that_were_trained_anew_are_loaded_anew(tmp_path: Path):
    motion = pumps.load(CLIPS / "jump.bvh")
    folder = write_random_weights(tmp_path / "weights", seed=1)
    first = pumps.infill(motion, [0, 30, 55], weights=folder)
    shutil.rmtree(folder)
    write_random_weights(folder, seed=2)
    second = pumps.infill(motion, [0, 30, 55], weights=folder)
    assert np.abs(first.rotations - second.rotations).max() > 1e-4


def test_weights_are_loaded_once_for_many_motions(tmp_path: Path, monkeypatch):
    folder, loaded = write_random_weights(tmp_path / "weights", seed=3), []
    load = kept_models.load_weights
    monkeypatch.setattr(kept_models, "load_weights", lambda *given: loaded.append(given) or load(*given))
    for name in ("jump.bvh", "kick.bvh", "jump.bvh"):
        pumps.infill(pumps.load(CLIPS / name), "every:15", weights=folder)
    assert len(loaded) == 1


def test_motions_are_compared_and_counted_by_identity():
    motion = pumps.load(CLIPS / "walk.bvh")
    assert motion == motion and motion != pumps.load(CLIPS / "walk.bvh") and len({motion, motion}) == 1


def test_the_page_names_all_of_it():
    named = set(re.findall(r"pumps\.(\w+)", PAGE)) | set(re.findall(r"`(\w+)`", PAGE))
    assert set(pumps.__all__) - {"__version__"} <= named
    used = set(re.findall(r"pumps\.(\w+)\(", PAGE))
    assert used <= set(pumps.__all__)


@pytest.mark.parametrize("code", EXAMPLES)
def test_every_line_of_the_pages_runs(code: str, tmp_path: Path, fast_python: tuple[str, ...]):
    for name in ("stages", "docs"):
        (tmp_path / name).symlink_to(ROOT / name)
    environment = {"PYTHONPATH": str(ROOT), "PATH": "/usr/bin:/bin", "OMP_NUM_THREADS": "1"}
    done = subprocess.run([*fast_python, "-c", code], cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
