"""`pumps decode --network`: clouds of other skeletons, rigid or dense, and latents, onto one rig."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from data_schemas.artefact import open_artefact, write_artefact
from data_schemas.errors import InputError, UsageError
from data_schemas.latent import LatentWriter
from data_schemas.motion import MotionReader
from data_schemas.tpc import ClipRow, TpcReader, TpcWriter
from stages.decode.config import Config
from stages.decode.run import run
from stages.shared.inference.models import load_autoencoder
from stages.shared.inference.skeleton_decoding import decode_cloud, load_rig_network
from tests.shared.inference.examples import write_random_weights
from tests.shared.inference.rig_networks import write_random_rig_network
from tests.shared.training.tiny_clouds import write_clouds


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Path:
    """`tpc` rigid and `dense` the same at sigma 0.05, `net` a rig's network, `ae` and `latent` of random latents."""
    folder = tmp_path_factory.mktemp("onto")
    write_clouds(folder / "tpc", clips=3, frames=30)
    write_random_rig_network(folder / "net", above=True)
    write_random_weights(folder)
    with (
        TpcReader(folder / "tpc") as reader,
        write_artefact(folder / "dense", "tpc", stage="test", config={}, inputs=[reader.artefact]) as draft,
        TpcWriter(draft.folder) as writer,
    ):
        for row in reader.clips:
            writer.add_dense(ClipRow(**{**vars(row), "skeleton": ""}), *reader.points(row.clip))
    coder = load_autoencoder(folder / "ae", "cpu")
    rng = np.random.default_rng(0)
    with (
        write_artefact(folder / "latent", "latent", stage="test", config={}) as draft,
        LatentWriter(draft.folder, coder.digest) as writer,
    ):
        row = ClipRow("clip", "clip.bvh", "0" * 64, "x", 20, 30.0, 20 / 30, "train", "CC0")
        latents = rng.normal(size=(20, coder.encoder.latent_width)).astype(np.float32)
        writer.add(row, latents, np.zeros((20, 3), np.float32))
    return folder


def config(made: Path, output: Path, **options) -> Config:
    paths = {
        key: made / value for key, value in options.items() if key in ("tpc", "latent", "ae", "network", "motion")
    }
    return Config(**{"splits": ("train", "val"), "device": "cpu", "output": output, **options, **paths})


def test_clouds_of_both_layouts_become_motions_of_the_rig(made, tmp_path):
    report = run(config(made, tmp_path / "rigid", tpc="tpc", network="net"))
    run(config(made, tmp_path / "dense", tpc="dense", network="net"))
    assert report.figures["clips"] == 3 and report.figures["method"] == "network"
    network = load_rig_network(made / "net", "cpu")
    with MotionReader(tmp_path / "rigid") as rigid, MotionReader(tmp_path / "dense") as dense:
        assert rigid.skeletons() == dense.skeletons() and len(rigid.skeletons()) == 1
        skeleton = rigid.skeleton(rigid.skeletons()[0])
        assert skeleton.names == network.rig.skeleton.names
        assert set(rigid.artefact.manifest.licences) == {"CC0", "test only"}
        for row in rigid.clips:
            one, two = rigid.motion(row.clip), dense.motion(row.clip)
            np.testing.assert_array_equal(one.rotations, two.rotations)  # positions and groups are all that counts
        with TpcReader(made / "tpc") as clouds:
            expected = decode_cloud(network, *clouds.points("clip1"))
        np.testing.assert_allclose(rigid.motion("clip1").root_positions, expected.root_positions, atol=1e-6)


def test_the_solve_from_the_networks_pose(made, tmp_path):
    assert run(config(made, tmp_path / "both", tpc="tpc", network="net", method="both")).figures["method"] == "both"
    run(config(made, tmp_path / "network", tpc="tpc", network="net"))
    with MotionReader(tmp_path / "both") as both, MotionReader(tmp_path / "network") as network:
        one, two = both.motion("clip1"), network.motion("clip1")
        assert not np.allclose(one.rotations, two.rotations, atol=1e-3)


def test_latents_onto_the_rig(made, tmp_path):
    options = {"latent": "latent", "ae": "ae", "network": "net", "points": 60}
    run(config(made, tmp_path / "one", **options))
    run(config(made, tmp_path / "two", **options))
    with MotionReader(tmp_path / "one") as reader:
        assert reader.motion("clip").frames == 20
    digests = [open_artefact(tmp_path / name).manifest.digest for name in ("one", "two")]
    assert digests[0] == digests[1]


@pytest.mark.parametrize(
    ("options", "error", "says"),
    [
        ({}, UsageError, "Either latents or clouds"),
        ({"tpc": "tpc", "latent": "latent", "ae": "ae"}, UsageError, "Either latents or clouds"),
        ({"latent": "latent"}, UsageError, "autoencoder"),
        ({"tpc": "tpc"}, UsageError, "onto the rig of a network"),
        ({"tpc": "tpc", "network": "net", "method": "solve"}, UsageError, "no keyframes"),
        ({"tpc": "tpc", "network": "net", "motion": "tpc"}, UsageError, "no keyframes"),
        ({"latent": "latent", "ae": "ae", "method": "both"}, UsageError, "needs the network"),
        ({"tpc": "tpc", "network": "ae"}, InputError, "no network of a rig"),
        ({"tpc": "tpc", "network": "net", "splits": ("test",)}, InputError, "no clip in the splits"),
        ({"tpc": "net", "network": "net"}, InputError, "tpc"),
    ],
)
def test_refusals(made, tmp_path, options, error, says):
    with pytest.raises(error, match=says):
        run(config(made, tmp_path / "out", **options))
    assert not (tmp_path / "out" / "manifest.json").exists()
