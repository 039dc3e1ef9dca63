"""The reader accepts every spelling of a BVH found in public data, and names the faults of other files."""

from __future__ import annotations

import re

import numpy as np
import pytest

from data_schemas.errors import InputError
from data_schemas.notes import sentences_of
from stages.shared.formats.bvh import read_bvh
from tests.shared.formats.bvh_texts import BvhText


@pytest.mark.parametrize(
    "text",
    [
        BvhText(),
        BvhText(newline="\r\n"),
        BvhText(newline="\r"),
        BvhText(indent="\t", separator="\t"),
        BvhText(separator="   "),
        BvhText(number="{:.8e}"),
        BvhText(row_end=" "),
        BvhText(row_end=" ", newline="\r\n"),
        BvhText(end_site=False),
        BvhText(orders={"Head": ("Xrotation", "Yrotation", "Zrotation"), "LeftArm": ("Yrotation", "Zrotation")}),
        BvhText(orders={"Neck": ()}),
        BvhText(placed=("Hips", "Spine", "LeftHand")),
        BvhText(above="joint_Root"),
        BvhText(names={"LeftArm": "Bip01 L UpperArm", "Head": "頭"}),
    ],
    ids=lambda text: "",
)
def test_spellings_give_the_same_numbers(text: BvhText) -> None:
    bvh = read_bvh(text.data(), "walk.bvh")
    assert np.allclose(bvh.values, text.values(), atol=1e-5)
    assert [joint.name for joint in bvh.joints] == [(text.names or {}).get(n, n) for n, _, _ in text.joints()]
    assert bvh.header == text.header()
    assert (bvh.header + bvh.motion_head).encode() == text.data()[: len((bvh.header + bvh.motion_head).encode())]
    assert bvh.newline == text.newline
    assert bvh.warnings == []


def test_rows_are_kept_byte_for_byte() -> None:
    text = BvhText(separator="\t", newline="\r\n", row_end=" ")
    lines = text.data().split(b"\r\n")
    assert read_bvh(text.data(), "a").rows == [line for line in lines[-13:] if line]


def test_blank_lines_byte_order_mark_and_lower_case() -> None:
    text = BvhText().text()
    rows = text.split("Frame Time: 0.0333333\n")[1].splitlines()
    spaced = text.replace("\n".join(rows), "\n\n" + "\n\n".join(rows) + "\n\n   \n")
    bvh = read_bvh(("\ufeff" + spaced).encode(), "a")
    assert np.array_equal(bvh.values, read_bvh(text.encode(), "a").values)
    lower = re.sub(r"\b(HIERARCHY|ROOT|JOINT|OFFSET|CHANNELS|MOTION|End Site)\b", lambda m: m[0].lower(), text)
    assert np.array_equal(read_bvh(lower.encode(), "a").values, bvh.values)


def test_braces_on_the_name_line_and_end_site_spellings() -> None:
    text = re.sub(r"(ROOT \w+|JOINT \w+|End Site)\n\s*\{", r"\1 {", BvhText().text()).replace("End Site", "EndSite")
    assert len(read_bvh(text.encode(), "a").joints) == 21


def test_rows_broken_over_lines_are_joined() -> None:
    text = BvhText().text()
    head, rows = text.split("Frame Time: 0.0333333\n")
    broken = head + "Frame Time: 0.0333333\n" + rows.replace(" ", "\n")
    assert np.array_equal(read_bvh(broken.encode(), "a").values, read_bvh(text.encode(), "a").values)


def test_bytes_that_are_not_utf8_are_kept() -> None:
    data = BvhText().data().replace(b"LeftHand", b"M\xe3o_L hand")
    bvh = read_bvh(data, "a")
    assert bvh.header.encode(bvh.encoding) in data


@pytest.mark.parametrize("declared", [11, 13])
def test_a_frame_count_one_off_is_a_warning_with_both_numbers(declared: int) -> None:
    (warning,) = sentences_of(read_bvh(BvhText(declared=declared).data(), "a").warnings)
    assert str(declared) in warning and "12" in warning


def _edited(old: str, new: str, count: int = 1) -> bytes:
    text = BvhText().text()
    assert old in text
    return text.replace(old, new, count).encode()


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"", "empty"),
        (b"   \n", "empty"),
        (b"hello\n", "HIERARCHY"),
        ("HIERARCHY".encode("utf-16"), "plain text"),
        (BvhText().data()[:600], "MOTION"),
        (BvhText().data()[:-40], f"line {len(BvhText().text().splitlines())}"),
        (BvhText().header().encode() + b"MOTION\nFrames: 0\nFrame Time: 0.03\n", "no frames"),
        (BvhText(frame_time="0").data(), "Frame Time"),
        (BvhText(frame_time="nan").data(), "Frame Time"),
        (BvhText(frame_time="-0.03").data(), "Frame Time"),
        (BvhText(frame_time="fast").data(), "'fast'"),
        (BvhText(declared=99999999999).data(), "99999999999"),
        (BvhText(declared=6).data(), "Frames says 6"),
        (_edited("Frames: 12", "Frames: many"), "'many'"),
        (_edited("Frames: 12\n", ""), "Frames"),
        (_edited("JOINT Spine", "ROOT Spine"), "second ROOT 'Spine'"),
        (_edited("JOINT LeftLeg", "JOINT LeftUpLeg"), "'LeftUpLeg' is defined twice"),
        (_edited("CHANNELS 3 Zrotation", "CHANNELS 4 Zrotation"), "line 9"),
        (_edited("CHANNELS 3 Zrotation", "CHANNELS 3 Wrotation"), "'Spine'"),
        (_edited("CHANNELS 3 Zrotation", "CHANNELS 3 Yrotation"), "twice"),
        (_edited("CHANNELS 3", "CHANNELS 99999999"), "count of 0 to 6"),
        (_edited("OFFSET 0.000000 20.000000", "OFFSET 0.000000 x"), "OFFSET of 'Spine'"),
        (_edited("OFFSET 0.000000 20.000000", "OFFSET 0.000000 inf"), "finite"),
        (_edited("OFFSET 0.000000 20.000000 0.000000\n", "\n"), "'Spine' has no OFFSET"),
        (_edited("JOINT Spine", "JOINT"), "no name"),
        (_edited("JOINT Spine", "JOINT Spine }"), "'}' is outside the braces"),
        (_edited("JOINT Spine", "KNEE Spine"), "'KNEE'"),
        (_edited("}\nMOTION", "MOTION"), "never closed"),
        (_edited("}\nMOTION", "}\n}\nMOTION"), "'}' has no matching '{'"),
        (_edited("ROOT Hips\n{", "ROOT Hips\n{\n{"), "'{'"),
        (_edited("End Site\n          {", "End Site\n          {\nEnd Site\n{"), "End Site"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_bad_files_are_refused_with_place_and_reason(data: bytes, says: str) -> None:
    with pytest.raises(InputError, match=re.escape(says)) as caught:
        read_bvh(data, "clips/walk.bvh")
    assert "clips/walk.bvh" in caught.value.message
    assert caught.value.exit_code == 3


@pytest.mark.parametrize("word", ["nan", "inf", "-inf", "1e999", "x", "1,5", "0x10", "1_0"])
def test_a_bad_number_is_named_with_line_frame_and_joint(word: str) -> None:
    lines = BvhText().text().split("\n")
    row = lines[-5].split(" ")
    row[7] = word
    lines[-5] = " ".join(row)
    with pytest.raises(InputError) as caught:
        read_bvh("\n".join(lines).encode(), "a.bvh")
    assert f"line {len(lines) - 4}" in caught.value.message
    assert "'Spine'" in caught.value.message


def test_unreadable_rows_can_be_kept_as_nan() -> None:
    lines = BvhText().text().split("\n")
    lines[-4], lines[-6] = "rubbish, not numbers", lines[-6] + " 5"
    bvh = read_bvh("\n".join(lines).encode(), "a", keep_unreadable_rows=True)
    assert np.flatnonzero(np.isnan(bvh.values).any(axis=1)).tolist() == [7, 9]
    assert bvh.rows[9] == b"rubbish, not numbers"
    picked = bvh.select(np.array([0, 11]))
    assert picked.frames == 2 and np.isfinite(picked.values).all() and picked.rows[1] == bvh.rows[11]


def test_deep_and_wide_headers_cost_bounded_work() -> None:
    deep = "HIERARCHY\nROOT a\n{\n" + "".join(f"JOINT j{i}\n{{\n" for i in range(100_000))
    with pytest.raises(InputError, match="more than"):
        read_bvh((deep + "MOTION\n").encode(), "a")
    with pytest.raises(InputError, match="MOTION"):
        read_bvh(b"HIERARCHY\n" + b"OFFSET " * 3_000_000, "a")
