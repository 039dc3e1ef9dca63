"""Whatever bytes a reader is given: motion, or an InputError that names the file; soon, and in little memory.

PUMPS_FUZZ=20 multiplies the number of damaged files by 20. The counts stand at the end of the report.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from data_schemas.errors import InputError
from stages.shared.formats import archives
from stages.shared.formats.readers import FORMATS, format_named, recognise
from stages.shared.formats.recording import Asked
from stages.shared.formats.sources import find_sources
from tests.shared.formats.hostile import TARGETS, WORDS, an_archive, check_recordings

SCALE = int(os.environ.get("PUMPS_FUZZ", "1"))
_PARTS, _EACH = 4, 500
_LONGEST_S = 5.0  # of processor time for files of a few kilobytes; a hang is what it looks for


def _check(data: bytes, rig: bytes, name: str, chosen: str) -> bool:
    """Read it; True where it was still motion."""
    begun = time.process_time()
    try:
        recognise(data, name)
        recordings = format_named(chosen).read(
            data, name, Asked(rig=rig, rig_name="rig" if rig else "", trim_first="auto")
        )
    except InputError as error:
        assert name in error.message or "rig" in error.message, error.message
        assert error.message.count("\n") == 0 and len(error.message) < 1000
        return False
    finally:
        assert time.process_time() - begun < _LONGEST_S
    check_recordings(recordings)
    for recording in recordings:
        assert not any(c in name for name in recording.skeleton.names for c in "{}\n")
    return True


def test_every_format_is_a_target() -> None:
    assert {target.format for target in TARGETS.values()} == {each.name for each in FORMATS}


@pytest.mark.parametrize("part", range(_PARTS))
@pytest.mark.parametrize("kind", TARGETS)
def test_damaged_files(kind: str, part: int, record_property: Callable[[str, object], None]) -> None:
    target = TARGETS[kind]
    rng = np.random.default_rng(part)
    read = sum(_check(*target.make(rng), target.name, target.format) for _ in range(_EACH * SCALE))
    record_property("damaged_files", f"{kind} {_EACH * SCALE} {read}")
    assert 0 < read < _EACH * SCALE, "damage must neither always kill nor never"


@pytest.mark.parametrize("kind", TARGETS)
@settings(max_examples=60 * SCALE, deadline=None)
@given(data=st.data())
def test_arbitrary_bytes(kind: str, data: st.DataObject) -> None:
    target = TARGETS[kind]
    whole, rig = target.make(np.random.default_rng(0))
    start = data.draw(
        st.sampled_from([b"", whole[:4], whole[:60], whole[: len(whole) // 2], b"{", b"PK\x03\x04", b"\x93NUMPY"])
    )
    middle = data.draw(
        st.one_of(st.binary(max_size=200), st.lists(st.sampled_from(WORDS), max_size=40).map(b" ".join))
    )
    end = data.draw(st.sampled_from([b"", whole[-100:], whole[len(whole) // 2 :]]))
    _check(start + middle + end, rig, target.name, target.format)


@pytest.mark.parametrize("kind", ["zip", "tar", "tar.gz", "tar.bz2", "tar.xz"])
def test_damaged_archives(kind: str, tmp_path: Path, record_property: Callable[[str, object], None]) -> None:
    rng = np.random.default_rng(0)
    path = tmp_path / f"a.{kind}"
    read = 0
    for _ in range(_EACH * SCALE):
        path.write_bytes(an_archive(kind, rng))
        archives.forget()
        begun = time.process_time()
        try:
            for source in find_sources([str(path)]):
                assert len(source.read()) == source.size
                assert ".." not in source.member.split("/") and not source.member.startswith("/")
            read += 1
        except InputError as error:
            assert path.name in error.message
        assert time.process_time() - begun < _LONGEST_S
    record_property("damaged_files", f"{kind} {_EACH * SCALE} {read}")
    assert list(tmp_path.iterdir()) == [path]
