"""The fuzzer's targets run on their own seeds and on damaged ones; atheris is not needed for that."""

from __future__ import annotations

import numpy as np
import pytest

from stages.shared.formats.readers import FORMATS
from tests.fuzz.targets import FUZZ_TARGETS, arrays_of, dictionary_of
from tests.shared.formats.hostile import WORDS, mutated


@pytest.mark.parametrize("name", FUZZ_TARGETS)
def test_a_target_runs_on_its_seeds_and_on_damaged_ones(name: str) -> None:
    target = FUZZ_TARGETS[name]
    seeds = target.seeds()
    assert seeds
    rng = np.random.default_rng(0)
    for seed in seeds[:4]:
        target.run(seed)
        for _ in range(10):
            target.run(mutated(seed, rng, [*WORDS, *target.words]))
    target.run(b"")


def test_every_format_is_fuzzed() -> None:
    text = " ".join(FUZZ_TARGETS)
    for each in FORMATS:
        assert each.name in text


def test_a_target_notices_what_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    from stages.shared.formats import bvh_motion

    monkeypatch.setattr(bvh_motion, "read_bvh_motion", lambda *given: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        FUZZ_TARGETS["bvh"].run(FUZZ_TARGETS["bvh"].seeds()[0])


def test_bytes_change_arrays() -> None:
    sound = {"a": np.zeros((2, 3)), "b": np.ones(4)}
    assert arrays_of(b"", sound).keys() == {"a", "b"}
    assert arrays_of(bytes([1, 0, 0, 0, 0, 0, 0, 0, 0]), sound).keys() == {"b"}
    changed = arrays_of(bytes([1, 1, 2, 1, 3, 2, 5, 7, 0]) + b"\0\0\x80\x3f", sound)["b"]
    assert changed.dtype == np.float32 and changed.shape == (3, 2, 5) and (changed == 1).all()


def test_the_dictionary_is_libfuzzers() -> None:
    assert dictionary_of((b"a\n", b"a\n", b'"')) == '"\\x61\\x0a"\n"\\x22"\n'
