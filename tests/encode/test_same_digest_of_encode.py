"""`pumps encode` ten times: one digest, whatever the compressed bytes are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from data_schemas.artefact import open_artefact, verify
from data_schemas.latent import LatentReader
from stages.encode.config import Config
from stages.encode.run import run
from tests.shared.inference.examples import write_random_weights
from tests.shared.training.tiny_clouds import write_clouds

RUNS = 10


@pytest.mark.parametrize("half", [True, False])
def test_ten_runs_have_one_digest(tmp_path: Path, half: bool) -> None:
    clouds, ae = write_clouds(tmp_path / "tpc"), write_random_weights(tmp_path) / "ae"
    litter = []  # memory that earlier runs have used holds other bytes
    for number in range(RUNS):
        run(Config(tpc=clouds, ae=ae, output=tmp_path / f"latent-{number}", half=half, device="cpu"))
        litter.append(np.random.default_rng(number).bytes(1000 + 100_000 * number))
    manifests = [open_artefact(tmp_path / f"latent-{number}").manifest for number in range(RUNS)]
    assert len({manifest.digest for manifest in manifests}) == 1
    assert all(verify(tmp_path / f"latent-{number}") == [] for number in range(RUNS))
    run(Config(tpc=clouds, ae=ae, output=tmp_path / "fewer", half=half, points=32, device="cpu"))
    assert open_artefact(tmp_path / "fewer").manifest.digest != manifests[0].digest
    with LatentReader(tmp_path / "latent-0") as reader:
        assert len(reader.clips) == 6
