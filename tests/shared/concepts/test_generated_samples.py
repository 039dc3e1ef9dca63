"""Published output of Action2Motion's generators, in files of its layout; and what is refused."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest

from data_schemas.errors import InputError
from stages.shared.concepts.data_sets import body_of_list, y_up
from stages.shared.concepts.generated_samples import positions_of_samples
from stages.shared.formats.smpl import neutral_joints


def places(count: int, frames: int) -> np.ndarray:
    """(N, T, 24, 3) of standing bodies in a camera's axes, Y down; the joints of SMPL."""
    joints = np.array(neutral_joints("smpl").offsets)[:24]
    for joint, parent in enumerate(body_of_list("smpl24").parents[1:].tolist(), start=1):
        joints[joint] += joints[parent]
    joints = y_up(joints)  # the same turn back
    moves = np.random.default_rng(0).normal(size=(count, frames, 1, 3)) * 0.01
    return (joints[None, None] + moves).astype(np.float32)


def write(folder: Path, array: np.ndarray, classes: list[int], lines: str = "(0, '01')\n(4, '05')\n") -> None:
    (folder / "joints").mkdir(parents=True)
    (folder / "label_enc_rev_humanact12.txt").write_text(lines)
    np.save(folder / "joints" / "motion_joints100.npy", array.reshape(*array.shape[:2], -1))
    np.save(folder / "joints" / "motion_class.npy", np.array(classes))


def test_a_folder_and_an_archive_give_the_same_motions(tmp_path: Path):
    given = places(3, 10)
    write(tmp_path / "one", given, [4, 0, 4])
    with zipfile.ZipFile(tmp_path / "set.zip", "w") as archive:
        for path in sorted((tmp_path / "one").rglob("*.*")):
            archive.write(path, f"set/one/{path.relative_to(tmp_path / 'one')}")
    for source in (tmp_path / "one", Path(f"{tmp_path / 'set.zip'}!set/one"), tmp_path / "set.zip"):
        found = positions_of_samples(source)
        assert [clip.action for clip in found] == ["drink", "warm_up", "drink"]
        assert {clip.row.split for clip in found} == {"test"} and found[0].row.fps == 20
        np.testing.assert_allclose(found[1].positions, given[1] * np.array([1.0, -1.0, -1.0]))
        assert found[0].positions[0, 15, 1] > found[0].positions[0, 0, 1]  # the head is above the pelvis
        assert found[0].scale == pytest.approx(1, abs=0.2)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"classes": [4, 1]}, "does not name"),
        ({"classes": [4]}, "one class for each"),
        ({"lines": "(0, __import__('os'))\n"}, "expected one like"),
        ({"lines": "(1e999, '01')\n"}, "expected one like"),
        ({"lines": f"(0, '{'1' * 5000}')\n(4, '05')\n"}, "no action '1111"),
        ({"lines": "(0, '13')\n(4, '05')\n"}, "no action '13'"),
        ({"factor": 10}, "no joints in metres"),
        ({"factor": np.nan}, "not finite"),
        ({"joints": 20}, "expected motions, frames, 72"),
    ],
)
def test_bad_files_are_named(tmp_path: Path, change: dict, words: str):
    array = (places(2, 6) * change.get("factor", 1))[:, :, : change.get("joints", 24)]
    write(tmp_path / "g", array, change.get("classes", [4, 0]), change.get("lines", "(0, '01')\n(4, '05')\n"))
    with pytest.raises(InputError, match=words):
        positions_of_samples(tmp_path / "g")


def test_a_folder_without_or_with_several_generators_is_refused(tmp_path: Path):
    with pytest.raises(InputError, match="no label_enc_rev"):
        positions_of_samples(tmp_path)
    for name in "ab":
        write(tmp_path / name, places(1, 6), [0])
    with pytest.raises(InputError, match="2 generators: a, b"):
        positions_of_samples(tmp_path)
    with pytest.raises(InputError, match="not a folder"):
        positions_of_samples(tmp_path / "c")
