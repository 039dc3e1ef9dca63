"""The page in a browser: open, set keys, fill, compare, undo, save, compare bytes; by keyboard and on a phone.

It runs where Playwright and Chromium are there. STUDIO_PICTURES=1 writes the pictures of docs/studio.md again.
"""

from __future__ import annotations

import base64
import os
import re
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.studio import surface
from stages.studio.opened_page import opened_page
from tests.shared.formats.gltf_files import GltfText
from tests.shared.meshes.figures import box_man

pytest.importorskip("starlette")
playwright = pytest.importorskip("playwright.sync_api")
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
if CHROMIUM is None:
    pytest.skip("no Chromium is installed", allow_module_level=True)

ROOT = Path(__file__).resolve().parents[2]
CLIPS = ROOT / "stages" / "shared" / "clips"
PICTURES = ROOT / "docs" / "pictures"
TAGS = "<img src=x onerror=alert(1)>.bvh"
_FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--hide-scrollbars"]
_ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT)}


@contextmanager
def studio(folder: Path) -> Iterator[str]:
    """The command as a user types it; its address."""
    words = [sys.executable, "-m", "pumps_cli", "studio", str(folder / "walk.bvh"), "--no-browser", "--device", "cpu"]
    process = subprocess.Popen(words, stderr=subprocess.PIPE, text=True, env=_ENVIRONMENT)
    try:
        assert process.stderr is not None
        told = process.stderr.readline()
        found = re.search(r"http://127\.0\.0\.1:\d+/[\w-]{32}/", told)
        assert found, told
        yield found[0]
    finally:
        process.kill()
        process.wait()


def walking() -> Any:
    """The skeleton and the motion of the walk."""
    return motion_of(read_bvh((CLIPS / "walk.bvh").read_bytes(), "walk.bvh"))[:2]


def until(page: Any, condition: str, seconds: float = 120.0) -> None:
    """Wait for a condition of the page. Its policy forbids what Playwright's own waiting does (eval)."""
    end = time.monotonic() + seconds
    while not page.evaluate(f"() => Boolean({condition})"):
        assert time.monotonic() < end, f"{condition}: {page.inner_text('#status')}"
        time.sleep(0.03)


def picture(page: Any, name: str) -> None:
    """A picture of the walk, for docs/studio.md."""
    page.wait_for_timeout(300)
    taken = page.screenshot()
    assert len(taken) > 10_000
    if os.environ.get("STUDIO_PICTURES"):
        (PICTURES / f"studio-{name}.png").write_bytes(taken)


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as started:
        opened = started.chromium.launch(executable_path=CHROMIUM, args=_FLAGS)
        yield opened
        opened.close()


def test_a_walk_through_the_page(
    browser: Any, tmp_path: Path, fast_python: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "motions"
    folder.mkdir()
    shutil.copy(CLIPS / "walk.bvh", folder)
    shutil.copy(CLIPS / "kick.bvh", folder / TAGS)
    (folder / "several.glb").write_bytes(GltfText(parts=("walk", "-run <b>")).data())
    wrong: list[str] = []
    asked: list[str] = []
    with studio(folder) as address:
        page = browser.new_page(viewport={"width": 1280, "height": 760}, reduced_motion="reduce")
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.on("console", lambda message: wrong.append(message.text) if message.type == "error" else None)
        page.on("request", lambda request: asked.append(request.url))
        with monkeypatch.context() as patched:
            patched.setattr("webbrowser.open", lambda url: True)
            with opened_page(address, tmp_path) as leading:
                page.goto(leading.as_uri())
                page.wait_for_url(address + "**")
        until(page, "window.studio?.begun && studio.motions.size && [...studio.motions.values()][0].there > 151")
        picture(page, "open")
        # By keyboard alone: a gap of two seconds from frame 30 to 90, filled.
        for _ in range(3):
            page.keyboard.press("Shift+ArrowRight")
        page.keyboard.press("[")
        for _ in range(6):
            page.keyboard.press("Shift+ArrowRight")
        page.keyboard.press("]")
        assert page.evaluate("studio.range") == [30, 90]
        page.click("#key-none")
        until(page, "studio.session.state.settings.constraints.keyframes.startsWith('0,15,30,90,')")
        page.keyboard.press("k")  # a key at 90 is there already: it goes
        until(page, "studio.session.undo === 'Removed a key'")
        page.keyboard.press("Control+z")
        until(page, "studio.session.state.settings.constraints.keyframes.includes(',90,') && studio.session.redo")
        page.keyboard.press("f")
        until(page, "studio.session.state.results.length === 1 && studio.shown.a !== 'm1'")
        made = page.evaluate("studio.session.state.results[0]")
        assert page.evaluate("[studio.shown.a, studio.shown.b]") == [made, "m1"]
        # A key dragged on the timeline, and a second fill beside the first.
        box = page.locator("#timeline").bounding_box()
        at = {frame: box["x"] + page.evaluate(f"studio.timeline.x({frame})") for frame in (105, 110)}
        page.mouse.move(at[105], box["y"] + 28)
        page.mouse.down()
        page.mouse.move(at[110], box["y"] + 28, steps=4)
        page.mouse.up()
        until(page, "studio.session.state.settings.constraints.keyframes.includes(',110,')")
        page.keyboard.press("Control+z")
        until(page, "studio.session.state.settings.constraints.keyframes.includes(',105,')")
        page.select_option("#compare", "slider")
        page.evaluate("studio.timeline.listen.seek(60)")
        picture(page, "compare")
        page.keyboard.press("c")
        assert page.evaluate("document.getElementById('compare').value") == "beside"
        # What is seen is in the picture: A and B differ in the gap.
        apart = "Math.max(...studio.motions.get(studio.shown.a).distances(studio.motions.get('m1')))"
        assert page.evaluate(apart) > 1
        # The ghost of the plain interpolation, by keyboard: A differs from it in the gap, and nothing does at a key.
        page.keyboard.press("g")
        until(page, "studio.plain.motion?.there > 151 && studio.timeline.data.plain")
        plain = page.evaluate("[...studio.timeline.data.plain]")
        assert plain[60] > 20 and max(plain[30], plain[90], plain[135]) < 1
        assert page.evaluate("studio.view.figures.has('plain')")
        page.evaluate("studio.timeline.listen.seek(60)")
        picture(page, "plain")
        page.keyboard.press("k")  # a key in the gap, where it follows
        until(page, "studio.plain.motion?.there > 151 && studio.plain.of.includes(',60,')")
        page.keyboard.press("Control+z")
        until(page, "studio.plain.motion?.there > 151 && !studio.plain.of.includes(',60,')")
        page.keyboard.press("g")
        until(page, "!studio.plain.motion && !studio.view.figures.has('plain')")
        # Saved, and made again by the commands that the page shows.
        page.keyboard.press("Control+s")
        page.fill("#name", "filled.bvh")
        page.click("#save-now")
        until(page, "document.getElementById('saved').textContent.startsWith('Saved')")
        picture(page, "save")
        commands = page.inner_text("#commands").splitlines()
        page.click("#save-close")
        # A reload, a dark phone: nothing is lost, and nothing is wider than the screen.
        page.reload()
        until(page, f"window.studio?.begun && studio.session.state.results[0] === '{made}'")
        page.emulate_media(color_scheme="dark")
        page.set_viewport_size({"width": 390, "height": 844})
        until(page, "document.documentElement.dataset.theme === 'dark'")
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
        picture(page, "phone")
        # A file whose name has tags is text everywhere; it begins a session of its own.
        page.keyboard.press("o")
        page.click(f"#files button:has-text('{TAGS}')")
        until(page, "studio.session.motions[studio.session.state.motion].name.includes('<img')")
        assert TAGS in page.inner_text("#file") and not page.query_selector("img")
        # A file of several clips: the page asks which.
        page.keyboard.press("o")
        page.click("#files button:has-text('several.glb')")
        until(page, "document.getElementById('clip-dialog').open")
        assert page.inner_text("#clips").split() == ["walk", "-run_<b>"]
        page.keyboard.press("Escape")
        until(page, "document.getElementById('status').textContent === ''")
        assert TAGS in page.inner_text("#file")
        page.keyboard.press("o")
        page.click("#files button:has-text('several.glb')")
        page.click("#clips button:has-text('-run_<b>')")
        until(page, "document.getElementById('file').textContent.startsWith('-run_<b> in several.glb')")
        # A body with a surface, of boxes here, in the place of the bones.
        packed = base64.b64encode(surface.packed(*surface.dressed(*walking(), *box_man()))).decode()
        page.evaluate(
            """async (packed) => {
                const { Body } = await import("./assets/body.js");
                const bytes = Uint8Array.from(atob(packed), (c) => c.charCodeAt(0));
                studio.motions.get(studio.shown.a).body = new Body(bytes.buffer);
                document.getElementById("surface").checked = true;
                studio.timeline.listen.seek(3);
            }""",
            packed,
        )
        until(page, "studio.view.figures.get('a').geometry?.attributes.position.array.some((each) => each > 0.5)")
        page.evaluate("document.getElementById('surface').checked = false; studio.timeline.listen.seek(4)")
        until(page, "studio.view.figures.get('a').bones")
        page.close()
    saved = (folder / "filled.bvh").read_bytes()
    (folder / "filled.bvh").unlink()
    assert commands == ["pumps infill walk.bvh --constraints filled.json --device=cpu -o filled.bvh"]
    words = [*fast_python, "-m", "pumps_cli", *shlex.split(commands[0])[1:], "--quiet"]
    subprocess.run(words, cwd=folder, check=True, env=_ENVIRONMENT)
    assert (folder / "filled.bvh").read_bytes() == saved
    assert not wrong
    assert {
        url.partition("/")[2].strip("/").partition("/")[0]
        for url in asked
        if "127.0.0.1" not in url and not url.startswith("file:")
    } == set()


def test_what_waits_on_a_page_replaces_nothing_of_another(browser: Any, tmp_path: Path) -> None:
    shutil.copy(CLIPS / "walk.bvh", tmp_path)
    shutil.copy(CLIPS / "kick.bvh", tmp_path)
    ready = "window.studio?.begun && studio.motions.size"
    with studio(tmp_path) as address:
        first = browser.new_page()
        first.goto(address)
        until(first, ready)
        second = browser.new_page()
        second.goto(f"{address}{first.evaluate('location.hash')}")
        until(second, ready)
        assert second.evaluate("studio.session.id") == first.evaluate("studio.session.id")
        second.fill("#seed", "7")
        second.press("#seed", "Enter")
        until(second, "studio.session.undo === 'Chose a seed'")
        second.close()
        # Two changes at once, of a page that does not know the seed: the first is refused, and the second is dropped.
        first.evaluate("studio.timeline.listen.moveKey('', 30, 31); studio.timeline.listen.moveKey('', 45, 46)")
        until(first, "document.getElementById('status').textContent.includes('Another page')")
        until(first, "document.getElementById('seed').value === '7'")
        first.keyboard.press("k")  # what follows knows it
        until(first, "studio.session.undo === 'Removed a key'")
        kept = first.evaluate("studio.session.state.settings")
        assert kept["seed"] == 7 and kept["constraints"]["keyframes"].startswith("15,30,45,60")
        # One button cancels all that runs or waits.
        first.fill("#samples", "8")
        first.evaluate("document.activeElement.blur()")
        for _ in range(3):
            first.keyboard.press("f")
        until(first, "studio.jobs() === 3")
        first.click("#cancel")
        until(first, "document.getElementById('cancel').hidden && studio.jobs() === 0")
        assert len(first.evaluate("studio.session.state.results")) <= 8  # the first one's, if it was ready already
        # The name of a saved file is that of the motion shown, and replacing is chosen each time.
        first.keyboard.press("Control+s")
        assert first.input_value("#name") == "walk.filled.bvh"
        first.check("#overwrite")
        first.click("#save-close")
        first.keyboard.press("o")
        first.click("#files button:has-text('kick.bvh')")
        until(first, "document.getElementById('file').textContent.startsWith('kick.bvh')")
        first.keyboard.press("Control+s")
        assert first.input_value("#name") == "kick.filled.bvh" and not first.is_checked("#overwrite")
        first.close()
