"""How true motions vary around a fill: its fit finds what residuals were drawn from, and its file is checked."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from data_schemas.errors import InputError
from stages.shared.inference.models import load_autoencoder
from stages.shared.inference.variation import (
    CENTROID,
    FEATURES,
    WAVES,
    GapPath,
    Variation,
    read_variation,
    write_variation,
)
from stages.shared.weights.shipped import SHIPPED, VARIATION_NAME
from stages.weights.vary.fit import MODES, Residual, fit_variation

WIDTH = 32


def gap_of(rng: np.random.Generator, *, open_: bool = False, tokens: int | None = None) -> GapPath:
    """A gap of random length, speed and keys."""
    count = tokens or int(rng.integers(10, 40))
    times = np.arange(1.0, count + 1)
    path = np.arange(0.0, count + (1 if open_ else 2))
    latents = rng.uniform(0.2, 2.0) * rng.standard_normal((len(path), WIDTH)).cumsum(0)
    return GapPath(times, 0.0, None if open_ else count + 1.0, latents, path, float(rng.integers(0, 3)) / 2)


def some_variation(rng: np.random.Generator) -> Variation:
    directions = np.linalg.qr(rng.standard_normal((WIDTH, 16)))[0].T
    factor = rng.standard_normal((WAVES, 16 + CENTROID, MODES)) * np.array([1.0, 0.5, 0.3, 0.2])[:, None, None]
    factor[:, -CENTROID:] *= 0.02
    return Variation(directions, factor, np.array([[-2.0, 0.3, 0.6, 0.4], [-1.5, 0.0, 0.5, 0.5]]), "made")


def test_the_fit_finds_what_residuals_were_drawn_from():
    rng = np.random.default_rng(3)
    truth = some_variation(rng)
    residuals = []
    for number in range(3000):
        gap = gap_of(rng, open_=number % 4 == 0)
        latents, centroids = truth.draw(gap, rng)
        residuals.append(Residual("ab"[number % 2], gap, latents.astype(float), centroids.astype(float)))
    found = fit_variation(residuals, "made")
    for kind in (0, 1):  # the weights of what the scale depends on; the first one is a unit shared with the factor
        assert np.abs(found.scale[kind, 2:] - truth.scale[kind, 2:]).max() < 0.15
    gap = gap_of(rng, tokens=24)
    wanted, made = (
        np.concatenate([np.concatenate(each.draw(gap, rng), -1).ravel()[None] for _ in range(4000)])
        for each in (truth, found)
    )
    powers = [np.square(draws).sum(1).mean() for draws in (wanted, made)]
    assert 0.8 < powers[1] / powers[0] < 1.25
    covariances = [draws.T @ draws for draws in (wanted, made)]
    assert (covariances[0] * covariances[1]).sum() > 0.95 * np.prod([np.linalg.norm(c) for c in covariances])


def test_residuals_vanish_at_keys_and_grow_to_an_end_without_one():
    rng = np.random.default_rng(0)
    closed, open_ = gap_of(rng, tokens=30), gap_of(rng, tokens=30, open_=True)
    at_keys = replace(closed, times=np.array([0.0, 31.0]))
    assert np.abs(at_keys.waves()).max() < 1e-12
    assert np.abs(replace(open_, times=np.array([0.0, 30.0])).waves()[0]).max() < 1e-12
    assert np.allclose(np.abs(open_.waves()[-1]), 1.0)  # half a wave is at its top there
    backwards = replace(open_, times=np.arange(30.0), before=None, after=30.0)
    assert np.allclose(backwards.waves()[::-1], open_.waves()) and backwards.features().shape == (FEATURES,)


def test_the_same_generator_draws_the_same_and_the_power_follows_the_length():
    variation = some_variation(np.random.default_rng(1))
    gaps = [gap_of(np.random.default_rng(2), tokens=count) for count in (8, 60)]
    a, b = (variation.draw(gaps[0], np.random.default_rng([5, 1])) for _ in range(2))
    assert np.array_equal(a[0], b[0]) and np.array_equal(a[1], b[1])
    powers = [
        np.mean([np.square(variation.draw(gap, np.random.default_rng(n))[0]).mean() for n in range(200)])
        for gap in gaps
    ]
    sizes = [np.exp(2 * variation.scale[0] @ gap.features()) for gap in gaps]
    assert powers[1] / powers[0] == pytest.approx(sizes[1] / sizes[0], rel=0.25)


def test_no_gap_that_is_long_enough_is_no_fit():
    gap = gap_of(np.random.default_rng(0), tokens=4)
    with pytest.raises(ValueError, match="long enough"):
        fit_variation([Residual("a", gap, np.ones((4, WIDTH)), np.ones((4, 3)))], "made")


@pytest.fixture
def weights(tmp_path: Path) -> Path:
    for part in ("ae", "lms"):
        (tmp_path / part).symlink_to(SHIPPED / "small-free" / part)
    return tmp_path


def test_a_file_comes_back_and_a_bad_one_is_one_sentence(weights: Path):
    variation = some_variation(np.random.default_rng(1))
    with pytest.raises(InputError, match="do not hold how motions vary"):
        read_variation(weights, WIDTH, "made")
    path = weights / VARIATION_NAME
    write_variation(path, variation, {"windows": 3})
    back = read_variation(weights, WIDTH, "made")
    assert np.abs(back.factor - variation.factor).max() < 1e-5 and back.digest == "made"
    with pytest.raises(InputError, match="another autoencoder"):
        read_variation(weights, WIDTH, "other")
    with pytest.raises(InputError, match="do not fit"):
        read_variation(weights, WIDTH + 1, "made")
    for broken in ({"version": 2}, {"factor": [[1.0]]}, {"scale": "a"}, {"directions": None}):
        path.write_text(json.dumps({**json.loads(path.read_text()), **broken}))
        with pytest.raises(InputError, match="damaged"):
            read_variation(weights, WIDTH, "made")
        write_variation(path, variation, {})


def test_what_ships_belongs_to_its_weights():
    coder = load_autoencoder(SHIPPED / "small-free/ae", "cpu")
    assert read_variation("small-free", coder.encoder.latent_width, coder.digest).factor.shape[-1] == MODES
