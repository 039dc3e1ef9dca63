"""`pumps edit`: rows that stay keep their bytes, mirrors, rates, loops and joins are what they say, refusals."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pumps
from data_schemas.errors import InputError, UsageError
from stages.edit.join import run as join_run
from stages.registry import stage_named
from stages.shared.contract import StageReport
from stages.shared.editing import edited_file
from stages.shared.editing.mirror import mirror_of, mirrored
from stages.shared.editing.motion_files import MotionFile
from stages.shared.editing.placing import Placement, headings_of_motion, placement_after
from stages.shared.formats.bvh import BvhFile, read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.kinematics.forward_numpy import positions_of
from tests.shared.inference.examples import write_random_weights

CLIPS = Path("stages/shared/clips")
WALK, KICK, RUN = (CLIPS / f"{name}.bvh" for name in ("walk", "kick", "run"))
OTHER_RIG = Path("docs/examples/other_rig.bvh")


def read(path: Path) -> BvhFile:
    return read_bvh(path.read_bytes(), path.name)


def edit(verb: str, source: Path, output: Path, **options: Any) -> StageReport:
    stage = stage_named(f"edit-{verb}")
    return stage.runner()(stage.config_type().model_validate({"input": source, "output": output, **options}))


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> str:
    return str(write_random_weights(tmp_path_factory.mktemp("weights")))


def test_trim_keeps_bytes(tmp_path: Path):
    edit("trim", WALK, tmp_path / "a.bvh", frames="10:50")
    edit("trim", WALK, tmp_path / "b.bvh", seconds=f"{10 / 30}:{50 / 30}")
    made, true = read(tmp_path / "a.bvh"), read(WALK)
    assert list(made.rows) == list(true.rows[10:50])
    assert made.header == true.header and made.motion_head == true.motion_head.replace("152", "40")
    assert (tmp_path / "a.bvh").read_bytes() == (tmp_path / "b.bvh").read_bytes()


@pytest.mark.parametrize("frames", ["50:10", "0:1000", "every:5", "3", "1,2"])
def test_trim_refuses(frames: str, tmp_path: Path):
    with pytest.raises((UsageError, InputError)):
        edit("trim", WALK, tmp_path / "a.bvh", frames=frames)
    assert not any(tmp_path.iterdir())


def test_resample_keeps_common_rows_and_comes_back(tmp_path: Path):
    edit("resample", WALK, tmp_path / "up.bvh", fps=90)
    up, true = read(tmp_path / "up.bvh"), read(WALK)
    assert list(up.rows[::3]) == list(true.rows) and up.frames == 3 * 151 + 1
    assert up.frame_time == pytest.approx(1 / 90)
    edit("resample", tmp_path / "up.bvh", tmp_path / "down.bvh", fps=30)
    assert list(read(tmp_path / "down.bvh").rows) == list(true.rows)


def test_resample_finds_frames_that_were_left_out(tmp_path: Path):
    """Half the frames of a walk, and the others made again: nearer to the truth than the mean of the neighbours."""
    walk = pumps.load(WALK)
    half = walk.record.at(slice(0, 151, 2))
    halved = replace(walk, record=replace(half, fps=15.0), source=b"")
    made, true = halved.resample(30).positions, walk.positions[:151]
    straight = (true[0:-2:2] + true[2::2]) / 2
    error = np.linalg.norm(made[1::2] - true[1::2], axis=-1).mean()
    assert error < 0.8 * np.linalg.norm(straight - true[1::2], axis=-1).mean()


@pytest.mark.parametrize("clip", ["kick", "walk", "crawl"])
def test_mirrored_twice_is_the_same_bytes(clip: str, tmp_path: Path):
    source = CLIPS / f"{clip}.bvh"
    edit("mirror", source, tmp_path / "once.bvh")
    edit("mirror", tmp_path / "once.bvh", tmp_path / "twice.bvh")
    assert (tmp_path / "twice.bvh").read_bytes() == source.read_bytes()
    assert (tmp_path / "once.bvh").read_bytes() != source.read_bytes()


@pytest.mark.parametrize("path", [KICK, OTHER_RIG, CLIPS / "dance_a.bvh"])
@pytest.mark.parametrize("across", ["x", "z"])
def test_mirrored_joints_are_images_of_their_partners(path: Path, across: str):
    skeleton, motion, _ = motion_of(read(path))
    mirror = mirror_of(skeleton, motion, across)
    made = mirrored(skeleton, motion, mirror)
    image = positions_of(skeleton, motion)[:, mirror.partner] * np.diag(mirror.world)
    assert np.linalg.norm(positions_of(skeleton, made) - image, axis=-1).max() < 0.03  # rigs are not quite symmetric
    back = mirrored(skeleton, made, mirror)
    assert np.abs(positions_of(skeleton, back) - positions_of(skeleton, motion)).max() < 1e-5


def test_a_mirrored_file_is_the_mirrored_motion(tmp_path: Path):
    skeleton, motion, _ = motion_of(read(KICK))
    edit("mirror", KICK, tmp_path / "m.bvh")
    written = motion_of(read(tmp_path / "m.bvh"))
    made = mirrored(skeleton, motion, mirror_of(skeleton, motion))
    assert np.abs(positions_of(*written[:2]) - positions_of(skeleton, made)).max() < 1e-4


def test_smooth_calms_and_keeps_both_ends(tmp_path: Path):
    edit("smooth", RUN, tmp_path / "s.bvh", seconds=0.3)
    made, true = read(tmp_path / "s.bvh"), read(RUN)
    assert (made.rows[0], made.rows[-1]) == (true.rows[0], true.rows[-1])
    bends = [np.abs(np.diff(positions_of(*motion_of(each)[:2])[1:-1], n=2, axis=0)).mean() for each in (made, true)]
    assert bends[0] < 0.9 * bends[1]


def test_a_loop_goes_on_and_its_seams_are_smooth(tmp_path: Path):
    report = edit("loop", WALK, tmp_path / "l.bvh", weights="small-free", device="cpu")
    figures = report.figures
    made, true = read(tmp_path / "l.bvh"), read(WALK)
    assert list(made.rows[: true.frames]) == list(true.rows)
    assert made.frames == true.frames + figures["bridge_frames"]
    assert max(figures["seam_jumps_mps"]) < 1.2 * figures["usual_jump_mps"]
    # The next repetition, put where the report says, begins one usual step after the last frame.
    skeleton, motion, _ = motion_of(made)
    pelvis = positions_of(skeleton, motion)[:, skeleton.root]
    step = pelvis[0] + figures["shift_m"] - pelvis[-1]
    usual = np.linalg.norm(np.diff(pelvis, axis=0), axis=-1)
    assert np.linalg.norm(step[[0, 2]]) < 1.5 * usual.max()


def test_join_puts_the_second_clip_where_the_first_ends(tmp_path: Path, weights: str):
    report = edit("join", WALK, tmp_path / "j.bvh", then=RUN, blend=0.5, weights=weights, device="cpu")
    made, walk, run = read(tmp_path / "j.bvh"), read(WALK), read(RUN)
    assert list(made.rows[: walk.frames]) == list(walk.rows)
    assert made.frames == walk.frames + 15 + run.frames and report.figures["bridge_frames"] == 15
    first = len(run.joints[0].channels)
    np.testing.assert_allclose(made.values[-run.frames :, first:], run.values[:, first:], atol=1e-6)
    skeleton, whole, _ = motion_of(made)
    _, second, _ = motion_of(run)
    put = whole.at(slice(-run.frames, None))
    away = positions_of(skeleton, put)[:, skeleton.root, 1] - positions_of(skeleton, second)[:, skeleton.root, 1]
    assert np.abs(away).max() < 1e-4  # heights stay
    assert np.abs(np.diff(made.values[:, 3:6], axis=0)).max() < 180  # no whole turn between frames


def test_join_without_a_gap_needs_no_weights_and_tells_of_the_jerk(tmp_path: Path):
    report = edit("join", WALK, tmp_path / "j.bvh", then=RUN, blend=0, weights="none there")
    assert read(tmp_path / "j.bvh").frames == read(WALK).frames + read(RUN).frames
    assert min(report.figures["seam_jumps_mps"]) > 1.2 * report.figures["usual_jump_mps"]
    assert report.lines[0].startswith("Filled no frame") and "jerk" in report.lines[1]


def test_the_largest_bend_of_a_bridge_is_told(tmp_path: Path, weights: str):
    """In half a second it is smooth; in two frames it is not, and the summary says so."""
    largest = {}
    for blend in (0.5, 0.07):
        out = tmp_path / f"{blend}.bvh"
        report = edit("join", WALK, out, then=RUN, blend=blend, weights=weights, device="cpu")
        skeleton, motion, _ = motion_of(read(out))
        places = positions_of(skeleton, motion)[:, skeleton.groups >= 0]
        bends = np.linalg.norm(np.diff(places, n=2, axis=0), axis=-1).mean(axis=1) * motion.fps
        first = read(WALK).frames
        count = report.figures["bridge_frames"]
        largest[blend] = report.figures["bridge_jump_mps"]
        assert largest[blend] == pytest.approx(bends[first - 1 : first - 1 + count].max(), rel=0.02)
        assert any("jerk" in line for line in report.lines) == (blend < 0.1)
    assert largest[0.07] > 2 * largest[0.5]


@pytest.mark.parametrize("frames", [1, 2])
def test_join_refuses_a_clip_that_shows_no_speed(frames: int, tmp_path: Path):
    edit("trim", WALK, tmp_path / "short.bvh", frames=f":{frames}")
    for first, second in ((WALK, tmp_path / "short.bvh"), (tmp_path / "short.bvh", WALK)):
        with pytest.raises(InputError, match="no speed at its ends"):
            edit("join", first, tmp_path / "j.bvh", then=second)
    assert not (tmp_path / "j.bvh").exists()


def test_times_may_have_their_unit(tmp_path: Path, weights: str):
    out = tmp_path / "j.bvh"
    edit("join", WALK, out, then=RUN, blend="0.2s", weights=weights, device="cpu")
    assert read(out).frames == read(WALK).frames + 6 + read(RUN).frames
    edit("smooth", WALK, tmp_path / "a.bvh", seconds="0.2 s")
    edit("smooth", WALK, tmp_path / "b.bvh", seconds=0.2)
    assert (tmp_path / "a.bvh").read_bytes() == (tmp_path / "b.bvh").read_bytes()
    with pytest.raises(ValueError, match="valid number"):
        edit("smooth", WALK, tmp_path / "c.bvh", seconds="0.2ms")


def test_the_continuation_of_a_clip_is_put_where_it_was():
    """Cut out of one walk, moved away and put back: within a step's length and a few degrees."""
    skeleton, motion, _ = motion_of(read(WALK))
    away = Placement(2.0, np.zeros(3), np.array([3.0, 0.0, -5.0]))
    before, rest = motion.at(slice(0, 60)), motion.at(slice(63, None))
    moved = away.of_motion(rest)
    back = placement_after(skeleton, before, moved, 4 / 30).of_motion(moved)
    apart = positions_of(skeleton, back)[0, skeleton.root] - positions_of(skeleton, rest)[0, skeleton.root]
    turned = headings_of_motion(skeleton, back)[0] - headings_of_motion(skeleton, rest)[0]
    assert np.linalg.norm(apart) < 0.05 and abs(np.degrees(turned)) < 10


def test_another_rig_is_refused_with_retarget_in_the_hint(tmp_path: Path):
    with pytest.raises(InputError) as refused:
        edit("join", WALK, tmp_path / "j.bvh", then=OTHER_RIG)
    assert "pumps retarget" in (refused.value.hint or "") and not any(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", [".glb", ".npz", ".csv", ".parquet"])
def test_other_formats_are_written(suffix: str, tmp_path: Path):
    edit("mirror", KICK, tmp_path / f"m{suffix}")
    if suffix == ".glb":
        edit("trim", tmp_path / "m.glb", tmp_path / "short.bvh", frames="5:25")
        assert read(tmp_path / "short.bvh").frames == 20
    else:
        assert (tmp_path / f"m{suffix}").stat().st_size > 1000


def test_python_gives_the_bytes_of_the_command(tmp_path: Path):
    kick = pumps.load(KICK)
    made = {
        "trim": (kick.trim(5, 25), {"frames": "5:25"}),
        "resample": (kick.resample(45), {"fps": 45}),
        "mirror": (kick.mirror(), {}),
        "smooth": (kick.smooth(0.2), {"seconds": 0.2}),
    }
    for verb, (motion, options) in made.items():
        edit(verb, KICK, tmp_path / f"{verb}.bvh", **options)
        pumps.save(motion, tmp_path / f"python_{verb}.bvh")
        assert (tmp_path / f"{verb}.bvh").read_bytes() == (tmp_path / f"python_{verb}.bvh").read_bytes(), verb


def test_python_joins_and_loops(weights: str):
    walk, run = pumps.load(WALK), pumps.load(RUN)
    assert walk.join(run, 0.2, weights=weights, device="cpu").frames == walk.frames + 6 + run.frames
    assert walk.loop(0.2, weights=weights, device="cpu").frames == walk.frames + 6


def test_outputs_are_not_overwritten(tmp_path: Path):
    (tmp_path / "a.bvh").write_bytes(b"mine")
    with pytest.raises(UsageError):
        edit("mirror", KICK, tmp_path / "a.bvh")
    assert (tmp_path / "a.bvh").read_bytes() == b"mine"


def test_a_bvh_of_another_name_is_joined_in_its_own_text(tmp_path: Path):
    """What the first file holds decides, not its suffix."""
    (tmp_path / "walk.txt").write_bytes(WALK.read_bytes())
    edit("join", tmp_path / "walk.txt", tmp_path / "j.bvh", then=KICK, blend=0)
    assert read(tmp_path / "j.bvh").frames == read(WALK).frames + read(KICK).frames


def test_python_joins_a_motion_that_has_no_text():
    walk, kick = pumps.load(WALK), pumps.load(KICK)
    made = walk.join(replace(kick, source=b""), 0)
    assert made.frames == walk.frames + kick.frames and made.source == b""


def test_notes_on_the_second_file_name_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def read_with_note(config: Any, path: Path) -> MotionFile:
        return replace(edited_file.file_asked(config, path), notes=("Something is assumed.",))

    monkeypatch.setattr(join_run, "file_asked", read_with_note)
    notes = edit("join", WALK, tmp_path / "j.bvh", then=KICK, blend=0).figures["notes"]
    assert f"{KICK}: Something is assumed." in notes
