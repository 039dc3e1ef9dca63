"""`pumps measure denoise`: known errors for known noise, the same noise for all, refusals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from data_schemas.errors import InputError, UsageError
from data_schemas.metrics import read_metrics
from stages.measure.denoise.config import Config
from stages.measure.denoise.run import run
from stages.measure.denoise.windows import with_noise
from stages.shared.inference.denoising import positions_in
from tests.measure.motions.test_measure_motions import write
from tests.shared.inference.examples import humanoid, swinging

TRUE = {f"clip{number}": swinging(humanoid(), 90, seed=number) for number in range(6)}


def test_mending_beats_filters_and_clean_motion_stays(tmp_path: Path):
    write(tmp_path / "truth", TRUE)
    settings = {"motion": tmp_path / "truth", "window": 90, "overwrite": True}
    run(Config(**settings, output=tmp_path / "paper"))
    rows, page = read_metrics(tmp_path / "paper")
    means = {
        method: np.mean([row.value for row in rows if row.method == method and row.metric == "mpjpe_mm"])
        for method in dict.fromkeys(row.method for row in rows)
    }
    assert list(means) == ["noisy", "savgol", "one-euro", "butterworth", "laplacian", "mend"]
    assert means["mend"] < 0.5 * min(value for name, value in means.items() if name != "mend")
    assert "least MPJPE on" not in page  # there is no clip to tune on
    run(Config(**settings, noise="clean", output=tmp_path / "clean"))
    clean = [row for row in read_metrics(tmp_path / "clean")[0] if row.metric == "mpjpe_mm"]
    assert all(row.value == 0 for row in clean if row.method == "noisy")
    assert np.mean([row.value for row in clean if row.method == "mend"]) < 2


def test_noise_is_on_the_body_and_the_pelvis():
    skeleton = humanoid(above=True)
    motion = swinging(skeleton, 40)
    made = with_noise(skeleton, motion, "paper", np.random.default_rng(0))
    assert (made.root_positions == motion.root_positions).all()
    np.testing.assert_allclose(made.rotations[:, 0], motion.rotations[:, 0], atol=1e-6)
    assert np.abs(positions_in(made) - positions_in(motion)).max() > 0.005
    assert with_noise(skeleton, motion, "clean", np.random.default_rng(0)) is motion


def test_bad_input_is_refused(tmp_path: Path):
    write(tmp_path / "truth", TRUE)
    settings = {"motion": tmp_path / "truth", "output": tmp_path / "never"}
    with pytest.raises(UsageError, match="no noise 'rain'"):
        run(Config(**settings, noise="rain"))
    with pytest.raises(InputError, match="no clip of 900 frames"):
        run(Config(**settings, window=900))
    assert not (tmp_path / "never").exists()
