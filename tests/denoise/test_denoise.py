"""`pumps denoise`: what is clean keeps its bytes, noise and gaps are mended, options limit it, refusals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from data_schemas.errors import InputError, UsageError
from stages.denoise.config import Config
from stages.denoise.run import run
from stages.shared.formats.bvh import BvhFile, read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.formats.bvh_write import write_bvh
from stages.shared.kinematics.forward_numpy import positions_of
from stages.shared.kinematics.motion_filters import FILTERS

WALK = Path("stages/shared/clips/walk.bvh")
GAP = slice(60, 66)


def read(path: Path) -> BvhFile:
    return read_bvh(path.read_bytes(), path.name)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A walk with noise on a third of its frames, and rows of zeros."""
    made = tmp_path_factory.mktemp("denoise")
    bvh, rng = read(WALK), np.random.default_rng(0)
    bad = np.zeros(bvh.frames, bool)
    bad[rng.permutation(np.arange(2, bvh.frames - 2))[: bvh.frames // 3]] = True
    values = bvh.values.copy()
    values[bad, 3:] += rng.normal(0, 12, values[bad, 3:].shape)
    values[GAP] = 0
    bad[GAP] = False
    touched = bad.copy()
    touched[GAP] = True
    kept = {int(row): int(row) for row in np.flatnonzero(~touched)}
    (made / "noisy.bvh").write_bytes(write_bvh(bvh, values, kept))
    np.save(made / "bad.npy", bad)
    return made


def cleaned(folder: Path, name: str, **options) -> tuple[BvhFile, dict]:
    output = folder / f"{name}.bvh"
    values = {"input": folder / "noisy.bvh", "output": output, "fill": "none", "device": "cpu", "overwrite": True}
    report = run(Config(**(values | options)))
    return read(output), report.figures


def error_mm(bvh: BvhFile, frames=slice(None)) -> float:
    made, true = (positions_of(*motion_of(each)[:2])[frames] for each in (bvh, read(WALK)))
    return 1000 * float(np.linalg.norm(made - true, axis=-1).mean())


def test_noise_is_mended_and_clean_frames_keep_their_bytes(folder: Path):
    noisy, bad = read(folder / "noisy.bvh"), np.load(folder / "bad.npy")
    made, figures = cleaned(folder, "mended")
    assert error_mm(made, bad) < 0.35 * error_mm(noisy, bad)
    assert error_mm(made, GAP) < 60 < error_mm(noisy, GAP)
    same = [row for row in range(made.frames) if made.rows[row] == noisy.rows[row]]
    assert len(same) == figures["kept_frames"] > 0.4 * made.frames
    assert made.header == noisy.header and figures["frames"] == made.frames
    assert {row["joint"] for row in figures["joints"]} <= set(motion_of(made)[0].names)


def test_long_gaps_are_filled_by_weights(folder: Path):
    bvh = read(WALK)
    rows = list(bvh.rows)
    text = WALK.read_bytes()
    start = text.index(rows[50])
    stop = text.index(rows[70])
    newline = bvh.newline.encode()
    broken = text[:start] + newline.join([b" ".join([b"nan"] * bvh.values.shape[1])] * 20) + newline + text[stop:]
    (folder / "gap.bvh").write_bytes(broken)
    given = {"input": folder / "gap.bvh"}
    plain, _ = cleaned(folder, "plain", **given)
    made, figures = cleaned(folder, "filled", **given, fill="small-free")
    assert figures["filled_by_weights"] == [(50, 69)] and np.isfinite(made.values).all()
    assert error_mm(made, slice(50, 70)) != error_mm(plain, slice(50, 70)) and error_mm(made, slice(50, 70)) < 150


@pytest.mark.parametrize("method", list(FILTERS))
def test_plain_filters_smooth_every_frame(folder: Path, method: str):
    made, figures = cleaned(folder, method, method=method)
    assert figures["kept_frames"] <= 2 and figures["method"] == method  # the ends may stay
    rough, smooth = (
        np.abs(np.diff(each.values[: GAP.start, 3:], n=2, axis=0)).mean()
        for each in (read(folder / "noisy.bvh"), made)
    )
    assert smooth < 0.8 * rough


def test_frames_joints_and_strength_limit_what_changes(folder: Path):
    noisy = read(folder / "noisy.bvh")
    made, _ = cleaned(folder, "frames", method="savgol", frames="10:20")
    differ = [row for row in range(made.frames) if made.rows[row] != noisy.rows[row]]
    assert differ == [*range(10, 20), *range(GAP.start, GAP.stop)]
    made, figures = cleaned(folder, "joint", method="savgol", joints="left_knee")
    outside = np.r_[0 : GAP.start, GAP.stop : made.frames]
    columns = np.flatnonzero((made.values != noisy.values)[outside].any(axis=0))
    knee = next(joint for joint in made.joints if joint.name == "left_knee")
    assert set(columns) <= set(range(knee.first_channel, knee.first_channel + len(knee.channels)))
    _, figures = cleaned(folder, "none", strength=0.0)
    assert figures["changed_frames"] == GAP.stop - GAP.start
    half, _ = cleaned(folder, "half", method="laplacian", width=3.0, strength=0.5)
    full, _ = cleaned(folder, "full", method="laplacian", width=3.0)
    moved = [np.abs(each.values - noisy.values)[outside].mean() for each in (half, full)]
    assert 0.3 * moved[1] < moved[0] < 0.7 * moved[1]


def test_a_mask_says_what_is_missing(folder: Path):
    frames = read(WALK).frames
    (folder / "mask.csv").write_text(
        "left_knee,left_hip\n" + "".join(f"{int(30 <= t < 40)},0\n" for t in range(frames))
    )
    made, figures = cleaned(folder, "masked", input=WALK, mask=folder / "mask.csv", strength=0.0)
    assert [row["joint"] for row in figures["joints"]] == ["left_knee"] and figures["changed_frames"] == 10
    assert 0 < error_mm(made, slice(30, 40)) < 40
    whole = "".join(f"{int(30 <= t < 40)}\n" for t in range(frames))
    (folder / "whole.csv").write_text(whole)
    _, figures = cleaned(folder, "whole", input=WALK, mask=folder / "whole.csv", strength=0.0)
    assert (30, 39) in figures["noisy_frames"]


def test_sides_that_are_exchanged_are_put_back(folder: Path):
    """Cleaning the walk with its legs exchanged in 30 frames gives what cleaning the walk itself gives."""
    bvh = read(WALK)
    values = bvh.values.copy()
    columns = {joint.name: slice(joint.first_channel, joint.first_channel + 3) for joint in bvh.joints}
    for part in ("hip", "knee", "ankle"):
        left, right = columns[f"left_{part}"], columns[f"right_{part}"]
        values[40:70, left], values[40:70, right] = bvh.values[40:70, right], bvh.values[40:70, left]
    kept = {row: row for row in range(bvh.frames) if not 40 <= row < 70}
    (folder / "exchanged.bvh").write_bytes(write_bvh(bvh, values, kept))
    given = {"input": folder / "exchanged.bvh"}
    made, figures = cleaned(folder, "back", **given)
    legs = {f"{side}_{part}" for side in ("left", "right") for part in ("hip", "knee", "ankle")}
    assert {row["joint"] for row in figures["swapped"]} == legs
    assert all(row["frames"] == [(40, 69)] for row in figures["swapped"])
    itself, _ = cleaned(folder, "itself", input=WALK)
    np.testing.assert_allclose(made.values, itself.values, atol=1e-4)
    assert [*made.rows[:40], *made.rows[70:]] == [*itself.rows[:40], *itself.rows[70:]]
    assert error_mm(read(folder / "exchanged.bvh"), slice(40, 70)) > 50
    half, _ = cleaned(folder, "half_strength", **given, strength=0.5)
    assert error_mm(half, slice(40, 70)) < 1
    for limits in ({"joints": "left_hip,left_knee"}, {"strength": 0.0}, {"method": "savgol"}):
        made, figures = cleaned(folder, "limited", **given, **limits)
        assert not figures["swapped"] and error_mm(made, slice(40, 70)) > 40
    _, figures = cleaned(folder, "some_frames", **given, frames="40:50")
    assert figures["swapped"][0]["frames"] == [(40, 49)] and figures["changed_frames"] == 10


def test_other_formats_are_written(folder: Path):
    report = run(Config(input=folder / "noisy.bvh", output=folder / "clean.glb", fill="none", overwrite=True))
    assert (folder / "clean.glb").read_bytes()[:4] == b"glTF" and report.figures["changed_frames"] > 0


@pytest.mark.parametrize(
    ("options", "kind", "words"),
    [
        ({"joints": "left_wing"}, InputError, "no joint 'left_wing'"),
        ({"frames": "500:600"}, InputError, "beyond the clip"),
        ({"weights": Path("runs/none"), "method": "savgol"}, UsageError, "methods mend"),
        ({"width": 2.0}, UsageError, "plain filters"),
        ({"mask": Path("none.csv")}, InputError, "cannot be read"),
        ({"weights": Path("stages/shared/weights/small-free/lms")}, InputError, "fine-tuned for a task"),
    ],
)
def test_bad_options_are_refused_and_nothing_is_written(folder: Path, options: dict, kind: type, words: str):
    output = folder / "never.bvh"
    with pytest.raises(kind, match=words):
        run(Config(input=folder / "noisy.bvh", output=output, **options))
    assert not output.exists()


@pytest.mark.parametrize(
    ("text", "words"),
    [("0\n1\n", "2 rows"), ("wing\n" + "0\n" * 152, "joint 'wing'"), ("0\n" * 151 + "2\n", "not 1 values")],
)
def test_bad_masks_are_refused(folder: Path, text: str, words: str):
    (folder / "bad.csv").write_text(text)
    with pytest.raises(InputError, match=words):
        run(Config(input=WALK, output=folder / "never.bvh", mask=folder / "bad.csv"))


def test_a_file_without_a_frame_that_is_there_is_refused(folder: Path):
    frames = read(WALK).frames
    (folder / "all.csv").write_text("1\n" * frames)
    with pytest.raises(InputError, match="all are missing"):
        run(Config(input=WALK, output=folder / "never.bvh", mask=folder / "all.csv"))
    with pytest.raises(ValidationError):
        Config(input=WALK, output=folder / "never.bvh", strength=1.5)
