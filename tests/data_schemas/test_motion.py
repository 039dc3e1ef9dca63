"""Some frames of a motion are a motion: by a slice or by number, with tracks and without."""

from dataclasses import replace

import numpy as np
import pytest

from tests.data_schemas.examples import a_motion


@pytest.mark.parametrize("tracked", [0, 2])
@pytest.mark.parametrize("frames", [slice(2, 7), slice(0), np.array([8, 1, 1])], ids=["slice", "none", "numbers"])
def test_frames_of_a_motion(tracked, frames):
    motion = a_motion(frames=10, joints=3, tracked=tracked)
    if not tracked:  # as a motion is made where nothing is said of tracks
        motion = replace(motion, tracks=np.zeros((0, 0, 3), np.float32))
    some = motion.at(frames)
    wanted = np.arange(10)[frames]
    assert some.frames == len(wanted) == len(some.root_positions) and some.fps == motion.fps
    assert some.tracks.shape == (len(wanted), tracked, 3)
    for place, frame in enumerate(wanted):
        assert (some.rotations[place] == motion.rotations[frame]).all()
        assert (some.root_positions[place] == motion.root_positions[frame]).all()
        assert not tracked or (some.tracks[place] == motion.tracks[frame]).all()
