"""The published output of Action2Motion's generators is read: joints in metres, or refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from data_schemas.errors import InputError
from stages.shared.concepts.generated_samples import positions_of_samples

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
ARCHIVE = DATA / "action2motion-samples.zip"

pytestmark = [pytest.mark.real, pytest.mark.skipif(not ARCHIVE.exists(), reason="no recordings beside the project")]


@pytest.mark.parametrize(
    ("generator", "joints", "frames"),
    [
        ("humanact12/vanila_vae_tf", 24, 60),
        ("mocap/vanila_vae_tf_2", 20, 100),
        ("ntu_rgbd_vibe/vanila_vae_tf_2", 18, 60),
    ],
)
def test_bodies_stand_upright_with_their_head_above(generator: str, joints: int, frames: int):
    found = positions_of_samples(Path(f"{ARCHIVE}!action2motion-samples/{generator}"))
    assert len(found) == 20
    for clip in found:
        assert clip.positions.shape == (frames, joints, 3)
        names = list(clip.body.names)
        assert clip.positions[0, names.index("head"), 1] > clip.positions[0, 0, 1]
        lengths = np.linalg.norm(clip.positions[:, 1:] - clip.positions[:, clip.body.parents[1:]], axis=-1)
        assert (lengths.std(axis=0) / lengths.mean(axis=0)).mean() < 0.4  # bones of what is generated change


def test_files_that_hold_no_metres_are_refused():
    with pytest.raises(InputError, match="no joints in metres"):
        positions_of_samples(Path(f"{ARCHIVE}!action2motion-samples/mocap/vanilla_vae_lie_mse_kld01"))
