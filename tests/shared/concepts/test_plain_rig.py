"""Positions become a motion of a rig, whose body is the one that the positions are of."""

from __future__ import annotations

import numpy as np
import pytest

from data_schemas.concepts import StoredBody
from data_schemas.motion import fault_of_motion, fault_of_skeleton
from stages.shared.concepts.body_positions import body_of, body_positions
from stages.shared.concepts.data_sets import body_of_list
from stages.shared.concepts.plain_rig import motion_of_positions, rig_of_positions
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from tests.shared.concepts.two_actions import CLIPS


@pytest.mark.parametrize("clip", ["walk", "spinkick"])
def test_positions_of_a_rigid_body_come_back(clip: str):
    skeleton, motion, _ = motion_of(read_bvh((CLIPS / f"{clip}.bvh").read_bytes(), clip))
    body = body_of(skeleton)
    places = body_positions(skeleton, motion, body)[:80]
    rig = rig_of_positions(StoredBody(body.names, body.parents, body.groups), [places])
    assert fault_of_skeleton(rig) is None
    found = body_of(rig)
    assert found.names == body.names and found.scale == pytest.approx(body.scale, rel=0.05)
    np.testing.assert_array_equal(found.parents, body.parents)
    np.testing.assert_array_equal(found.groups, body.groups)
    made = motion_of_positions(rig, places, 30.0)
    assert fault_of_motion(made, rig.joints) is None
    apart = np.linalg.norm(body_positions(rig, made, found) - places, axis=-1)
    # A joint with several bones turns by the rotation that fits them best; all others meet their places.
    assert apart.mean() < 0.005 and apart.max() < 0.03


@pytest.mark.parametrize("title", ["smpl24", "vibe18"])
def test_bones_of_changing_length_get_their_mean(title: str):
    body = body_of_list(title)
    rng = np.random.default_rng(0)
    places = np.zeros((40, len(body.names), 3))
    lengths = rng.uniform(0.1, 0.4, len(body.names))
    for joint in range(1, len(body.names)):
        direction = rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        factors = 1 + 0.05 * rng.normal(size=(40, 1))
        places[:, joint] = places[:, body.parents[joint]] + lengths[joint] * factors * direction
    rig = rig_of_positions(body, [places])
    np.testing.assert_allclose(np.linalg.norm(rig.offsets[1:], axis=1), lengths[1:], rtol=0.04)
    assert (np.linalg.norm(rig.tails, axis=1) > 0).all()
