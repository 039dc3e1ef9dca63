"""The documentation site builds without a warning, its links hold, and it loads nothing from other hosts."""

from __future__ import annotations

from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

from docs.site.build import PLAYER, build, places
from stages.report.config import Config as ReportConfig
from stages.report.run import run as write_report
from tests.docs.pages import ROOT

pytest.importorskip("zensical", reason="the site's generator is in the extra `docs`")
pytest.importorskip("mkdocstrings", reason="the site's reference needs the extra `docs`")

LOADS = {("script", "src"), ("img", "src"), ("iframe", "src"), ("link", "href"), ("source", "src"), ("video", "src")}
NOT_LOADED = {"canonical", "next", "prev", "alternate"}


class Page(HTMLParser):
    """What a page links to, what it loads, and the anchors that it has."""

    def __init__(self, path: Path):
        super().__init__()
        self.links: list[str] = []
        self.loads: list[str] = []
        self.anchors: set[str] = set()
        self.words = 0
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        self.anchors |= {given[name] for name in ("id", "name") if name in given}
        for name, value in given.items():
            if (tag, name) in LOADS and given.get("rel") not in NOT_LOADED:
                self.loads.append(value)
            elif name in ("href", "src"):
                self.links.append(value)

    def handle_data(self, data: str) -> None:
        self.words += len(data.split())


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, with a player of slerp alone: filling is tested elsewhere."""
    work = tmp_path_factory.mktemp("site")
    clip = ROOT / "stages" / "shared" / "clips" / "kick.bvh"
    write_report(ReportConfig(motions=(f"truth={clip}",), output=work / PLAYER))
    return build(work / "made", work / PLAYER)


@pytest.fixture(scope="module")
def pages(site: Path) -> dict[Path, Page]:
    return {path: Page(path) for path in site.rglob("*.html")}


def test_every_page_is_there(site: Path, pages: dict[Path, Page]):
    for place in places().values():
        assert pages[site / place.with_suffix(".html")].words > 100, place


def test_a_folder_that_holds_something_else_is_not_emptied(tmp_path: Path):
    (tmp_path / "walk.bvh").write_text("kept")
    with pytest.raises(SystemExit, match="something else than a site"):
        build(tmp_path, tmp_path / PLAYER)
    assert (tmp_path / "walk.bvh").read_text() == "kept"


def test_internal_links_lead_to_pages_files_and_anchors(pages: dict[Path, Page]):
    wrong, held = [], 0
    for path, page in pages.items():
        if path.name == "404.html":  # its links start at the site's root
            continue
        for link in (*page.links, *page.loads):
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            anchor = unquote(parts.fragment)
            there = target.is_file() and (not anchor or target not in pages or anchor in pages[target].anchors)
            held += there
            wrong += [] if there else [f"{path.name}: {link}"]
    assert not wrong
    assert held > 1000


def test_nothing_is_loaded_from_other_hosts(site: Path, pages: dict[Path, Page]):
    assert not [load for page in pages.values() for load in page.loads if urlsplit(load).netloc]
    for style in site.rglob("*.css"):
        text = style.read_text(encoding="utf-8")
        assert "url(http" not in text and "@import" not in text and "url(//" not in text, style


def test_the_search_holds_every_page(site: Path):
    """As a script, which pages opened as files can load."""
    index = (site / "search.js").read_text(encoding="utf-8")
    for place in places().values():
        assert f'"{place.with_suffix(".html").as_posix()}' in index, place


def test_the_reference_shows_the_public_interface(site: Path, pages: dict[Path, Page]):
    import pumps

    anchors = pages[site / "reference.html"].anchors
    shown = [name for name in pumps.__all__ if not name.startswith("_")]
    assert {f"pumps.{name}" for name in shown} <= anchors


def test_a_link_that_leads_nowhere_stops_the_build(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    from docs.site import build as building

    broken = tmp_path / "python.md"
    broken.write_text("# Page\n\nA [link](nowhere.md).\n")
    monkeypatch.setattr(building, "places", lambda: {broken: Path("python.md")})
    player = tmp_path / PLAYER
    player.write_text("<p>player</p>")
    with pytest.raises(SystemExit, match="does not exist"):
        build(tmp_path / "made", player)
