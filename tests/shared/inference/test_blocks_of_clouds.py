"""A clip whose clouds are found a block at a time is filled as if all of them were in memory at once."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from stages.shared.inference import decoded_clouds, filling, token_times
from stages.shared.inference.cloud_interfaces import CloudSource
from stages.shared.inference.cloud_sources import GivenLatents, ReconstructedClouds, SynthesisedClouds, TrueClouds
from stages.shared.inference.filling import fill_motion
from stages.shared.inference.models import Models, Span, load_weights, overlapping_windows, reach_of, touching
from stages.shared.inference.token_times import Tokens
from stages.shared.kinematics.runs import widened_to_keys
from tests.shared.inference.examples import humanoid, swinging

FRAMES = 200


@pytest.fixture(scope="module")
def models() -> Models:
    return load_weights("small-free", "cpu")


def keys_of(kind: str) -> np.ndarray:
    known = np.zeros(FRAMES, bool)
    if kind == "every 15":
        known[::15] = known[-1] = True
    elif kind == "transitions":  # the second gap lies across the border of two blocks
        known[:] = True
        known[40:70] = known[115:150] = known[190:196] = False
    else:  # "ahead": frames beyond the last key
        known[:100] = True
    return known


def latents_of(models: Models, frames: int) -> GivenLatents:
    drawn = torch.Generator().manual_seed(0)
    width = models.autoencoder.encoder.latent_width
    return GivenLatents(
        models.autoencoder, torch.randn(frames, width, generator=drawn), torch.randn(frames, 3, generator=drawn)
    )


@pytest.mark.parametrize(
    ("source", "kind"),
    [
        *(("synthesised", kind) for kind in ("every 15", "transitions", "ahead")),
        ("reconstructed", "transitions"),
        ("given", "every 15"),
        ("true", "transitions"),
    ],
)
def test_small_blocks_give_the_motion_of_one_block(models: Models, source: str, kind: str, monkeypatch) -> None:
    skeleton, known = humanoid(), keys_of(kind)
    motion = swinging(skeleton, FRAMES)
    clouds: CloudSource = {
        "synthesised": SynthesisedClouds(models),
        "reconstructed": ReconstructedClouds(models, motion),
        "given": latents_of(models, FRAMES),
        "true": TrueClouds(motion),
    }[source]
    monkeypatch.setattr(filling, "CHUNK_TOKENS", 64)
    monkeypatch.setattr(token_times, "SPREAD", 8)
    made = []
    for block in (FRAMES, 64):
        monkeypatch.setattr(filling, "BLOCK_TOKENS", block)
        monkeypatch.setattr(decoded_clouds, "BLOCK_TOKENS", block)
        made.append(fill_motion(skeleton, motion, known, clouds, points=48))
    whole, parts = made
    # Blocks give batches of other sizes, whose products round otherwise.
    np.testing.assert_allclose(parts.motion.rotations, whole.motion.rotations, atol=5e-5, rtol=0)
    np.testing.assert_allclose(parts.motion.root_positions, whole.motion.root_positions, atol=1e-5, rtol=0)
    assert (parts.plain == whole.plain).all() and parts.wander_m == pytest.approx(whole.wander_m, abs=1e-5)
    assert np.abs(whole.motion.rotations - motion.rotations)[~known].max() > 1e-3  # something was filled


def test_only_windows_in_which_a_frame_is_missing_are_computed(models: Models, monkeypatch) -> None:
    frames = 300
    known = np.ones(frames, bool)
    known[100:110] = False
    seen: dict[str, list[int]] = {"synthesiser": [], "decoder": []}
    for name, network in (("synthesiser", models.synthesiser), ("decoder", models.autoencoder.decoder)):
        run = network.forward

        def counted(latents, *rest, run=run, name=name, **named):
            seen[name].append(len(latents))
            return run(latents, *rest, **named)

        monkeypatch.setattr(network, "forward", counted)
    skeleton = humanoid()
    fill_motion(skeleton, swinging(skeleton, frames), known, SynthesisedClouds(models), points=48)
    # Windows of 96 by 48 over frames 100-109: two. Of 24 by 12 over 99-110: two or three in each view; and the plain
    # interpolation's around the frames in which points are bound to bones.
    assert sum(seen["synthesiser"]) == 4 * 2
    assert len(seen["decoder"]) % 2 == 0 and sum(seen["decoder"]) < 4 * (3 + frames / 12)


@given(st.integers(1, 200), st.integers(2, 40), st.data())
def test_windows_that_touch_frames_are_those_that_write_them(frames: int, window: int, data: st.DataObject) -> None:
    spans = [Span(start, stop, start, stop, fade) for start, stop, fade in overlapping_windows(frames, window)]
    first = data.draw(st.integers(0, frames - 1))
    last = data.draw(st.integers(first + 1, frames))
    rows = np.array(data.draw(st.lists(st.booleans(), min_size=last - first, max_size=last - first)))
    wanted = {frame for frame in range(first, last) if rows[frame - first]}
    some = touching(spans, first, last, rows)
    assert some == [span for span in spans if wanted & set(range(span.start, span.stop))]
    assert touching(spans, first, last) == touching(spans, first, last, np.ones(last - first, bool))
    low, high = reach_of(some, first, last)
    assert low <= first and high >= last
    for moved in (span.moved(-low) for span in some):
        assert 0 <= moved.first <= moved.start < moved.stop <= moved.last <= high - low


@given(st.lists(st.booleans(), min_size=1, max_size=60), st.data())
def test_widened_stretches_begin_and_end_at_keys_where_there_are_any(known: list[bool], data) -> None:
    first = data.draw(st.integers(0, len(known) - 1))
    last = data.draw(st.integers(first + 1, len(known)))
    low, high = widened_to_keys(np.flatnonzero(known), first, last)
    assert 0 <= low <= first and last <= high <= len(known)
    assert known[low] or not any(known[: first + 1])
    assert known[high - 1] or not any(known[last - 1 :])
    assert not any(known[low + 1 : first + 1]) and not any(known[last - 1 : high - 1])


def test_around_gaps_are_missing_tokens_and_the_keys_beside_them() -> None:
    known = np.array([0, 0, 1, 1, 1, 0, 1, 1], bool)
    around = Tokens(np.arange(8.0), known, 30.0).around_gaps()
    assert around.tolist() == [True, True, True, False, True, True, True, False]
