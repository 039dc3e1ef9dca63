"""Tables of motions, read back with csv and pyarrow alone."""

from __future__ import annotations

import csv
import io
import json

import numpy as np
import pyarrow.parquet as pq
import pytest
from scipy.spatial.transform import Rotation

from data_schemas.skeleton import BODY_GROUPS
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.formats.table_write import csv_of_motion, parquet_of_motion
from stages.shared.kinematics.forward_numpy import positions_of
from tests.shared.formats.bvh_texts import BvhText

SKELETON, MOTION, _ = motion_of(read_bvh(BvhText(frames=9, above="joint_Root", z_up=True).data(), "a"))


@pytest.mark.parametrize("values", ["both", "positions", "rotations"])
def test_csv(values: str) -> None:
    text = csv_of_motion(SKELETON, MOTION, values).decode()
    rows = list(csv.DictReader(io.StringIO(text)))
    assert [int(row["frame"]) for row in rows] == list(range(9))
    assert np.allclose([float(row["time"]) for row in rows], np.arange(9) / 30, atol=1e-6)
    assert ("Head.x" in rows[0]) == (values != "rotations") and ("Head.qw" in rows[0]) == (values != "positions")
    for joint, name in enumerate(SKELETON.names):
        if values != "rotations":
            found = np.array([[float(row[f"{name}.{axis}"]) for axis in "xyz"] for row in rows])
            assert np.abs(found - positions_of(SKELETON, MOTION)[:, joint]).max() < 1e-6
        if values != "positions":
            turns = np.array([[float(row[f"{name}.{axis}"]) for axis in ("qx", "qy", "qz", "qw")] for row in rows])
            away = Rotation.from_quat(turns) * Rotation.from_quat(MOTION.rotations[:, joint]).inv()
            assert away.magnitude().max() < 1e-5


def test_parquet_has_a_row_for_every_frame_and_joint() -> None:
    table = pq.read_table(io.BytesIO(parquet_of_motion(SKELETON, MOTION, "walk", "CC0")))
    assert table.num_rows == 9 * SKELETON.joints
    assert table.schema.names == [
        "clip", "frame", "time", "joint", "group", "x", "y", "z", "qx", "qy", "qz", "qw"
    ]  # fmt: skip
    about = json.loads(table.schema.metadata[b"pumps"])
    assert about["fps"] == 30 and about["names"] == list(SKELETON.names) and about["licence"] == "CC0"
    rows = table.to_pylist()
    expected = positions_of(SKELETON, MOTION)
    for row in rows[:: SKELETON.joints // 2]:
        joint = SKELETON.names.index(row["joint"])
        assert np.allclose([row["x"], row["y"], row["z"]], expected[row["frame"], joint], atol=1e-9)
        assert np.allclose([row[q] for q in ("qx", "qy", "qz", "qw")], MOTION.rotations[row["frame"], joint])
        group = SKELETON.groups[joint]
        assert row["group"] == (BODY_GROUPS[group] if group >= 0 else None) and row["clip"] == "walk"
        assert row["time"] == pytest.approx(row["frame"] / 30)
    # The rig in the file's metadata gives the same places by forward kinematics with SciPy alone.
    parents, offsets = about["parents"], np.array(about["offsets_m"])
    head, hips = about["names"].index("Head"), about["names"].index("Hips")
    by_name = {(row["frame"], row["joint"]): row for row in rows}
    for frame in range(9):
        chain = [head]
        while chain[-1] != hips:
            chain.append(parents[chain[-1]])
        at = np.array([by_name[frame, "Hips"][axis] for axis in "xyz"])
        for joint in reversed(chain[:-1]):
            turn = [by_name[frame, about["names"][parents[joint]]][q] for q in ("qx", "qy", "qz", "qw")]
            at = at + Rotation.from_quat(turn).apply(offsets[joint])
        assert np.allclose(at, [by_name[frame, "Head"][axis] for axis in "xyz"], atol=1e-5)
