"""Who may ask the studio for something, and what leads out of its folder."""

from __future__ import annotations

import os
import stat
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("starlette")
pytest.importorskip("httpx2")

from stages.studio import guard
from stages.studio.opened_page import opened_page
from tests.studio.bench_in_folder import CLIPS, HERE, PORT, TOKEN, Page, bench_in

_OUTSIDE = ["../secret.bvh", "/etc/passwd", "sub/../../secret.bvh", "link.bvh", "linked/secret.bvh", "..", "a\0b"]
_NO_NAMES = ["../a.bvh", "/tmp/a.bvh", "sub/a.bvh", ".a.bvh", "-o.bvh", "a.exe", "a", "a\nb.bvh", "con.bvh"]


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    with bench_in(tmp_path_factory.mktemp("guard") / "folder", "kick") as bench:
        yield Page(bench)


def _status(page: Page, path: str = f"/{TOKEN}/api/start", method: str = "GET", **headers: str | None) -> int:
    given = {name.replace("_", "-"): value for name, value in headers.items() if value is not None}
    request = page.client.build_request(method, path, headers=given)
    for name, value in headers.items():
        if value is None:
            request.headers.pop(name.replace("_", "-"), None)
    return page.client.send(request).status_code


def test_the_page_itself_may_ask(page: Page) -> None:
    assert _status(page) == 200
    assert _status(page, host=f"localhost:{PORT}", origin=f"http://localhost:{PORT}") == 200
    assert _status(page, f"/{TOKEN}/", origin=None, sec_fetch_site="none") == 200


@pytest.mark.parametrize(
    "host", ["evil.example", f"evil.example:{PORT}", "127.0.0.1:1", "", f"127.0.0.1:{PORT}.evil"]
)
def test_other_hosts_are_refused(page: Page, host: str) -> None:
    """A name of the attacker's that leads to the loopback address (DNS rebinding)."""
    assert _status(page, host=host, origin=f"http://{host}") == 403


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "https://127.0.0.1:8765", f"{HERE}.evil.example"])
def test_other_origins_are_refused(page: Page, origin: str) -> None:
    assert _status(page, origin=origin) == 403


def test_requests_that_change_something_name_their_origin(page: Page) -> None:
    assert _status(page, f"/{TOKEN}/api/open", "POST", origin=None) == 403


@pytest.mark.parametrize("site", ["cross-site", "same-site"])
def test_what_another_page_embeds_is_refused(page: Page, site: str) -> None:
    assert _status(page, origin=None, sec_fetch_site=site) == 403


def test_another_page_may_lead_to_this_one_and_to_nothing_else(page: Page) -> None:
    """The file that opens the page is of another origin, and so is what it leads to."""
    window = {"origin": None, "sec_fetch_site": "cross-site", "sec_fetch_mode": "navigate"}
    assert _status(page, f"/{TOKEN}/", **window, sec_fetch_dest="document") == 200
    assert _status(page, f"/{TOKEN}/", **window, sec_fetch_dest="iframe") == 403
    assert _status(page, f"/{TOKEN}/api/start", **window, sec_fetch_dest="document") == 403
    assert _status(page, "/a-token2/", **window, sec_fetch_dest="document") == 404


def test_the_token_is_in_no_command_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []
    begun = threading.Event()
    monkeypatch.setattr("webbrowser.open", lambda url: (asked.append(url), begun.set()))
    with opened_page(f"{HERE}/{TOKEN}/", tmp_path) as leading:
        assert begun.wait(10) and asked == [leading.as_uri()] and TOKEN not in asked[0]
        assert f"url={HERE}/{TOKEN}/" in leading.read_text()
        assert os.name == "nt" or stat.S_IMODE(leading.stat().st_mode) == 0o600
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "path", ["/", "/api/start", "/a-toke/api/start", "/a-token2/api/start", "/A-TOKEN/api", "//"]
)
def test_nothing_is_there_without_the_token(page: Page, path: str) -> None:
    assert _status(page, path) == 404


def test_tokens_differ_and_are_long() -> None:
    assert len({guard.new_token() for _ in range(100)}) == 100 and len(guard.new_token()) >= 32


def test_every_answer_forbids_what_the_page_does_not_need(page: Page) -> None:
    for path in (f"/{TOKEN}/", f"/{TOKEN}/api/start", f"/{TOKEN}/assets/studio.js", "/nothing"):
        headers = page.client.get(path).headers
        policy = headers["content-security-policy"]
        assert "default-src 'none'" in policy and "frame-ancestors 'none'" in policy and "unsafe" not in policy
        assert headers["referrer-policy"] == "no-referrer" and headers["x-content-type-options"] == "nosniff"
        assert "access-control-allow-origin" not in headers


def test_large_bodies_are_refused(page: Page, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guard, "MOST_JSON_BYTES", 1000)
    monkeypatch.setattr(guard, "MOST_BYTES", 2000)
    send = {"content-type": "application/json"}
    assert page.client.post(f"/{TOKEN}/api/open", content=b"x" * 1001, headers=send).status_code == 413
    assert page.client.post(f"/{TOKEN}/api/upload?name=a.bvh", content=b"x" * 2001).status_code == 413
    chunks = (b"x" * 400 for _ in range(10))  # states no length
    assert page.client.post(f"/{TOKEN}/api/upload?name=a.bvh", content=chunks).status_code == 413


@pytest.mark.parametrize("name", _OUTSIDE)
def test_nothing_outside_the_folder_is_read(page: Page, name: str) -> None:
    folder = page.bench.folder.path
    (folder.parent / "secret.bvh").write_bytes((CLIPS / "kick.bvh").read_bytes())
    for link, target in (("link.bvh", folder.parent / "secret.bvh"), ("linked", folder.parent)):
        if not os.path.lexists(folder / link):
            (folder / link).symlink_to(target)
    told = page.ask("open", "POST", {"file": name}, status=404)["error"]
    assert "folder of the studio" in told


@pytest.mark.parametrize(
    "name",
    _NO_NAMES,
)
def test_nothing_outside_the_folder_is_written(page: Page, name: str) -> None:
    session = page.ask("open", "POST", {"file": "kick.bvh"})
    before = sorted(page.bench.folder.path.parent.rglob("*"))
    motion = session["state"]["motion"]
    assert "cannot be the name" in page.post(session, "save", 400, motion=motion, name=name)["error"]
    assert sorted(page.bench.folder.path.parent.rglob("*")) == before


def test_saving_replaces_no_link_and_no_recording(page: Page) -> None:
    folder = page.bench.folder.path
    secret = folder.parent / "kept.bvh"
    secret.write_text("mine")
    (folder / "aim.bvh").symlink_to(secret)
    session = page.ask("open", "POST", {"file": "kick.bvh"})
    motion = session["state"]["motion"]
    assert "exists" in page.post(session, "save", 400, motion=motion, name="aim.bvh", overwrite=True)["error"]
    assert "recording" in page.post(session, "save", 400, motion=motion, name="kick.bvh", overwrite=True)["error"]
    assert secret.read_text() == "mine" and (folder / "kick.bvh").read_bytes() == (CLIPS / "kick.bvh").read_bytes()


@pytest.mark.parametrize("session", ["../../folder", "0" * 16, "x", "%2e%2e"])
def test_other_names_are_no_sessions(page: Page, session: str) -> None:
    assert page.client.get(f"/{TOKEN}/api/sessions/{session}").status_code == 404


@pytest.mark.parametrize(
    "body",
    [
        {},
        {"file": 3},
        {"file": "kick.bvh", "session": "nothing"},
        {"file": "kick.bvh", "session": [], "revision": 1},
        [],
        "text",
        None,
    ],
)
def test_odd_requests_are_one_sentence(page: Page, body: object) -> None:
    answer = page.client.post(f"/{TOKEN}/api/open", json=body)
    assert answer.status_code in (400, 404) and answer.json()["error"].endswith((".", "begin one."))


def test_odd_names_and_pipes_do_not_end_the_list(page: Page) -> None:
    folder = page.bench.folder.path
    (folder / os.fsdecode(b"odd\xff.bvh")).write_bytes((CLIPS / "kick.bvh").read_bytes())
    os.mkfifo(folder / "pipe.zip")
    assert "kick.bvh" in page.ask("files") and not any("odd" in name for name in page.ask("files"))
    send = {"content-type": "application/json"}
    told = page.client.post(f"/{TOKEN}/api/open", content=rb'{"file": "none\udcff.bvh"}', headers=send)
    assert told.status_code == 404 and told.json()["error"].startswith("none\udcff.bvh")


def test_a_verb_takes_no_path_and_no_setting_of_another(page: Page) -> None:
    session = page.ask("open", "POST", {"file": "kick.bvh"})
    for verb, options in (("trim", {"output": "/tmp/x"}), ("smooth", {"skeleton_map": "/etc/passwd"}), ("rm", {})):
        page.post(session, "edit", 400, verb=verb, options=options)
    settings = {**session["state"]["settings"], "weights": "/etc"}
    body = {"revision": session["revision"], "label": "x", "settings": settings}
    assert "no weights" in page.ask(f"sessions/{session['id']}/settings", "PUT", body, 400)["error"]


def test_names_from_files_are_never_markup() -> None:
    """No module of the page makes markup out of text."""
    assets = Path(guard.__file__).parent / "assets"
    for path in assets.glob("*.js"):
        text = path.read_text()
        for word in ("innerHTML", "outerHTML", "insertAdjacentHTML", "document.write", "eval(", "new Function"):
            assert word not in text, f"{path.name}: {word}"
