"""Arrays of frames in HDF5: equal chunks, checksums, no room wasted."""

from __future__ import annotations

import h5py
import numpy as np
import pytest

from data_schemas.hdf5_arrays import CHUNK_FRAMES, write_frames


@pytest.mark.parametrize("frames", [1, 255, 256, 257, 300, 1000])
def test_arrays_lie_in_equal_chunks_with_checksums_and_take_little_more_than_their_bytes(tmp_path, frames):
    values = np.random.default_rng(0).normal(size=(frames, 22, 4)).astype(np.float32)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        write_frames(file, "rotations", values)
        stored = file["rotations"]
        assert stored.fletcher32 and stored.chunks[0] <= CHUNK_FRAMES
        assert stored.id.get_storage_size() <= values.nbytes * (1 + 4 / frames) + 64
        assert np.array_equal(stored[()], values)
