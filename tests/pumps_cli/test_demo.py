"""`pumps demo`: an embedded clip filled, in a page beside the truth and plain interpolation."""

from __future__ import annotations

import json
import webbrowser
from pathlib import Path

import pytest

from pumps_cli.commands.demo import FILLED, PAGE, embedded_clips
from stages.shared.formats.bvh import read_bvh


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The addresses that were opened."""
    addresses: list[str] = []
    monkeypatch.setattr(webbrowser, "open", lambda address: addresses.append(address))
    return addresses


def test_it_fills_a_clip_and_opens_the_page(pumps, tmp_path: Path, opened: list[str]):
    ran = pumps("demo", "kick", "-o", tmp_path / "demo", "--json")
    assert ran.code == 0, ran.err
    page = tmp_path / "demo" / PAGE
    assert json.loads(ran.out)["output"] == str(page)
    assert opened == [page.resolve().as_uri()]
    held = page.read_text()
    assert all(f'"name":"{name}"' in held.replace('": "', '":"') for name in ("truth", "slerp", "filled"))
    paths = (tmp_path / "demo" / FILLED, embedded_clips()["kick"])
    filled, clip = ([*read_bvh(path.read_bytes(), path.name).rows] for path in paths)
    assert len(filled) == len(clip) and filled[::15] == clip[::15]
    assert filled != clip


def test_no_page_is_opened_where_it_is_not_wanted_or_not_made(pumps, tmp_path: Path, opened: list[str]):
    (tmp_path / FILLED).write_text("mine")
    ran = pumps("demo", "kick", "-o", tmp_path)
    assert ran.code == 2 and "--overwrite" in ran.err and (tmp_path / FILLED).read_text() == "mine"
    assert pumps("demo", "kick", "-o", tmp_path / "demo", "--no-open", "--quiet").out == ""
    assert not opened


def test_unknown_clips_are_refused_with_the_names_of_all(pumps, tmp_path: Path):
    ran = pumps("demo", "tango", "-o", tmp_path)
    assert ran.code == 2 and "'tango'" in ran.err and "walk" in ran.err
