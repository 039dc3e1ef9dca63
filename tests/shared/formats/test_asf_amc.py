"""ASF/AMC: joints are where the format's definition puts them, in every spelling; errors name the fault."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from data_schemas.errors import InputError
from stages.shared.formats.amc import read_amc, read_asf_amc
from stages.shared.formats.asf import read_asf
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.formats.bvh_of_motion import bvh_of_motion
from stages.shared.formats.recording import Asked, Recording
from stages.shared.kinematics.forward_numpy import positions_of
from tests.shared.formats.asf_texts import AsfText, worst_beside_pyacclaim

SPELLINGS = {
    "as-cmu": AsfText(),
    "unix": AsfText(newline="\n"),
    "old-mac": AsfText(newline="\r"),
    "radians": AsfText(radians=True),
    "root-order": AsfText(order="RZ RY RX TX TY TZ"),
    "axis-order": AsfText(axis_order="ZXY"),
    "channels": AsfText(channels={"lhand": "rz ry rx", "head": "ry", "lfoot": "", "ltibia": "rz rx"}),
    "centimetres": AsfText(length=2.54, scale=2.54 / 0.45),
    "root-tilted": AsfText(orientation=(0, 90, 0)),
}


def _read(text: AsfText, **options: object) -> Recording:
    asked = Asked(rig=text.asf(), rig_name="t.asf", **options)  # type: ignore[arg-type]
    (recording,) = read_asf_amc(text.amc(), "t.amc", asked)
    return recording


@pytest.mark.parametrize("text", SPELLINGS.values(), ids=SPELLINGS)
def test_joints_are_where_the_definition_puts_them(text: AsfText) -> None:
    recording = _read(text)
    skeleton, motion = recording.skeleton, recording.motion
    assert list(skeleton.names) == text.depth_first()
    assert np.allclose(positions_of(skeleton, motion), text.heads(), atol=1e-5)
    assert skeleton.unit_m == pytest.approx(0.0254 / text.length)
    assert skeleton.names[skeleton.root] == "root" and (skeleton.groups >= 0).all()


def test_joints_agree_with_an_independent_reader(tmp_path: Path) -> None:
    pytest.importorskip("pyacclaim")
    text = AsfText(newline="\n", frames=4)
    (tmp_path / "t.asf").write_bytes(text.asf())
    (tmp_path / "t.amc").write_bytes(text.amc() + b"5\n")  # it drops what follows the last number
    assert worst_beside_pyacclaim(tmp_path / "t.asf", tmp_path / "t.amc", _read(text), range(4)) < 1e-6


def test_the_rate_comes_from_the_file_the_user_or_cmu() -> None:
    assert _read(AsfText(rate=60)).motion.fps == 60 and _read(AsfText(rate=60)).remarks == []
    assert _read(AsfText(), fps_override=100.0).motion.fps == 100
    usual = _read(AsfText())
    assert usual.motion.fps == 120 and "120" in str(usual.remarks[0]) and usual.notes == []


def test_frames_line_by_line_are_the_frames_at_once() -> None:
    text = AsfText(newline="\n", frames=5)
    skeleton = read_asf(text.asf(), "t.asf")
    whole = read_amc(text.amc(), "t.amc", skeleton)
    lines = text.amc().decode().split("\n")
    first, second = lines.index("2") + 3, lines.index("2") + 4
    lines[first], lines[second] = lines[second], lines[first]  # another order of bones in one frame
    mixed = read_amc("\n".join(lines).encode(), "t.amc", skeleton)
    assert np.array_equal(mixed.values, whole.values)
    spaced = text.amc().replace(b"\nlfemur", b"\n\n  LFEMUR\t")
    assert np.array_equal(read_amc(spaced, "t.amc", skeleton).values, whole.values)


def test_blocks_give_the_same_result(monkeypatch: pytest.MonkeyPatch) -> None:
    text = AsfText(frames=9)
    skeleton = read_asf(text.asf(), "t.asf")
    whole = read_amc(text.amc(), "t.amc", skeleton).values
    for size in (256, 1000, 5000):
        monkeypatch.setattr("stages.shared.formats.amc._BLOCK", size)
        assert np.array_equal(read_amc(text.amc(), "t.amc", skeleton).values, whole)


def test_missing_frames_are_noted() -> None:
    text = AsfText(newline="\n")
    cut = re.sub(rb"\n3\nroot.*?\n4\n", b"\n4\n", text.amc(), flags=re.S)
    motion = read_amc(cut, "t.amc", read_asf(text.asf(), "t.asf"))
    assert len(motion.values) == 5 and "2 is followed by 4" in str(motion.notes[0])


def test_a_clip_can_be_given_as_bvh() -> None:
    text = AsfText(frames=4)
    recording = _read(text)
    bvh = read_bvh(bvh_of_motion(recording.skeleton, recording.motion, "clip"), "clip.bvh")
    skeleton, motion, _ = motion_of(bvh)
    assert skeleton.names == recording.skeleton.names
    ours = positions_of(recording.skeleton, recording.motion)
    assert np.allclose(positions_of(skeleton, motion) / skeleton.unit_m, ours / recording.skeleton.unit_m, atol=1e-3)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        (b"     name lfemur\n", b"", "no name"),
        (b"     name rfemur", b"     name lfemur", "twice"),
        (b"     length 7.2\n", b"", "has no direction or no length"),
        (b"length 7.2\n", b"length many\n", "line 27"),
        (b"dof rx ry rz", b"dof rx ry ry", "each once"),
        (b"ltibia lfoot", b"ltibia lfoot lfoot", "two parents"),
        (b"ltibia lfoot", b"ltibia lfut", "'lfut'"),
        (b"lhipjoint lfemur", b"ltibia lfemur", "is not connected to the root"),
        (b":bonedata", b":bones", "bonedata"),
        (b"  end\n:hierarchy", b":hierarchy", "has no end"),
        (b"20.0  XYZ", b"20.0  XYY", "XYZ in some order"),
    ],
)
def test_bad_skeletons_are_refused_with_line_and_bone(old: bytes, new: bytes, says: str) -> None:
    text = AsfText(newline="\n").asf()
    assert old in text
    with pytest.raises(InputError, match=re.escape(says)) as caught:
        read_asf(text.replace(old, new, 1), "bad.asf")
    assert "bad.asf" in caught.value.message


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        (b"\n3\n", b"\n3\nlfoot 1 2\n", "twice"),
        (b"\nltibia ", b"\nltibia 7 ", "2 values for 1 channels (rx)"),
        (b"\nltibia ", b"\nltobia ", "no bone 'ltobia'"),
        (b"\nhead ", b"\nhead nan ", "head"),
        (b":DEGREES\n1\n", b":DEGREES\nframe 1\n", "number of the first frame"),
        (b"\nroot ", b"\nhead 0 0 0\n2\nroot ", "no line for the root"),
    ],
)
def test_bad_motions_are_refused_with_line_and_bone(old: bytes, new: bytes, says: str) -> None:
    text = AsfText(newline="\n")
    assert old in text.amc()
    with pytest.raises(InputError, match=re.escape(says)) as caught:
        read_amc(text.amc().replace(old, new, 1), "bad.amc", read_asf(text.asf(), "t.asf"))
    assert "bad.amc" in caught.value.message


def test_a_cut_motion_and_a_missing_skeleton() -> None:
    text = AsfText(newline="\n")
    with pytest.raises(InputError, match=r"lfoot|rhand"):
        read_amc(text.amc()[:-60], "cut.amc", read_asf(text.asf(), "t.asf"))
    with pytest.raises(InputError, match="there is no ASF in its folder"):
        read_asf_amc(text.amc(), "alone.amc", Asked())
