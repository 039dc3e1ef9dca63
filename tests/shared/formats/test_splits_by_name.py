"""Splits as papers on AMASS list them: data sets and files by split, under old and new names."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from data_schemas.errors import InputError
from stages.shared.formats.sources import find_sources
from stages.shared.formats.splits import Assigned, assign_splits

# The data sets of SpecTrHuMS and of the papers that it follows.
PAPER = {
    "train": [
        "CMU", "MPI_Limits", "TotalCapture", "Eyes_Japan_Dataset", "KIT", "EKUT", "TCD_handMocap", "ACCAD",
    ],
    "test": ["BioMotionLab_NTroje"],
}  # fmt: skip


def _assigned(folder: Path, splits: object, *files: str) -> Assigned:
    for name in files:
        (folder / "amass" / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / "amass" / name).write_bytes(b"")
    (folder / "named.json").write_text(json.dumps(splits))
    return assign_splits(find_sources([str(folder / "amass")], (".npz",)), folder / "named.json")


def _by_end(assigned: Assigned) -> dict[str, str]:
    return {name.split("amass/")[1]: split for name, split in assigned.splits.items()}


def test_data_sets_under_the_names_of_both_releases(tmp_path: Path):
    old = (
        "CMU/01/01_01_poses.npz",
        "BioMotionLab_NTroje/rub001/0000_treadmill_poses.npz",
        "MPI_Limits/a/b_poses.npz",
    )
    new = ("BMLrub/rub002/0001_stageii.npz", "PosePrior/a/c_stageii.npz", "HumanEva/S1/Box_stageii.npz")
    assigned = _assigned(tmp_path, PAPER, *old, *new)
    assert _by_end(assigned) == {old[0]: "train", old[1]: "test", old[2]: "train", new[0]: "test", new[1]: "train"}
    left, missing = assigned.notes
    assert (
        left.startswith("1 of 6 files are in no split") and "names 6 data sets or files that are not there" in missing
    )


def test_a_file_counts_before_its_folder_and_an_inner_folder_before_an_outer_one(tmp_path: Path):
    named = {"train": ["CMU"], "vald": ["01"], "test": ["CMU/01/01_02.npz", "BMLrub/rub001/0001_stageii.npz"]}
    files = ("CMU/01/01_01_poses.npz", "CMU/01/01_02_poses.npz", "CMU/02/02_01_poses.npz")
    files += ("BioMotionLab_NTroje/rub001/0001_poses.npz",)
    assert list(_by_end(_assigned(tmp_path, named, *files)).values()) == ["test", "val", "test", "train"]


def test_folders_that_are_called_like_splits(tmp_path: Path):
    (tmp_path / "named.json").write_text(json.dumps({"train": {"test": ["b.npz"]}}))
    (tmp_path / "train").mkdir()
    for name in "ab":
        (tmp_path / "train" / f"{name}.npz").write_bytes(b"")
    assigned = assign_splits(find_sources([str(tmp_path / "train")], (".npz",)), tmp_path / "named.json")
    assert list(assigned.splits.values()) == ["train", "test"]


def test_splits_that_contradict_themselves_or_are_no_lists(tmp_path: Path):
    with pytest.raises(InputError, match="has 'cmu' in two splits"):
        _assigned(tmp_path, {"train": ["CMU"], "test": ["cmu"]}, "CMU/a.npz")
    with pytest.raises(InputError, match="the split 'test' must be a list of names"):
        _assigned(tmp_path, {"train": ["CMU"], "test": "BMLrub"}, "CMU/a.npz")
