"""How quick the studio is in a browser: opening, playing five minutes of 120 frames a second, filling two seconds.

    python benchmarks/studio.py

It needs Playwright and Chromium, and prints one line a figure and the load of the machine. Frames are counted for
five seconds. In a Chromium without a graphics card they are drawn by the processor (SwiftShader); so they are counted
again with three.js's drawing left out, which leaves the page's own work: poses, timeline, curves.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from playwright.sync_api import sync_playwright

from data_schemas.whole_file import write_whole
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_write import write_bvh

CLIP = Path(__file__).resolve().parents[1] / "stages" / "shared" / "clips" / "walk.bvh"
FRAMES, FPS = 36_000, 120
_FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]

_MAKE_A_GAP = """async () => {
  const { id, revision, state } = studio.session;
  const settings = { ...state.settings, constraints: { ...state.settings.constraints, keyframes: "30,90" } };
  const body = JSON.stringify({ revision, label: "gap", settings });
  const headers = { "content-type": "application/json" };
  const answer = await fetch(`api/sessions/${id}/settings`, { method: "PUT", headers, body });
  studio.session.revision = (await answer.json()).revision;
}"""


def long_clip() -> bytes:
    """The walk again and again for five minutes, at 120 frames a second."""
    bvh = read_bvh(CLIP.read_bytes(), CLIP.name)
    rows = bvh.values[[frame % bvh.frames for frame in range(FRAMES)]]
    return write_bvh(bvh, rows, {}, FRAMES, frame_time=1 / FPS)


def until(page: Any, condition: str, seconds: float = 300.0) -> float:
    """Seconds until a condition of the page holds."""
    began = time.perf_counter()
    while not page.evaluate(f"() => Boolean({condition})"):
        if time.perf_counter() - began > seconds:
            raise SystemExit(f"{condition} did not come: {page.inner_text('#status')}")
        time.sleep(0.01)
    return time.perf_counter() - began


def playing(page: Any) -> tuple[str, str]:
    """Frames drawn a second while the motion plays, and how long the page's scripts take for each."""
    metrics = page.context.new_cdp_session(page)
    metrics.send("Performance.enable")

    def now() -> tuple[float, float, float]:
        found = {each["name"]: each["value"] for each in metrics.send("Performance.getMetrics")["metrics"]}
        return page.evaluate("studio.view.drawn"), found["Timestamp"], found["ScriptDuration"]

    page.keyboard.press(" ")
    page.wait_for_timeout(1000)
    first = now()
    page.wait_for_timeout(5000)
    frames, seconds, scripts = (b - a for a, b in zip(first, now(), strict=True))
    page.keyboard.press(" ")
    return f"{frames / seconds:.1f} frames drawn a second", f"{1000 * scripts / frames:.1f} ms of scripts a frame"


def measured(folder: Path, clip: str, browser: Any) -> None:
    """Print the figures of one clip."""
    words = [sys.executable, "-m", "pumps_cli", "studio", str(folder / clip), "--no-browser", "--device", "cpu"]
    began = time.perf_counter()
    process = subprocess.Popen(words, stderr=subprocess.PIPE, text=True)
    try:
        assert process.stderr is not None
        address = re.search(r"http://\S+", process.stderr.readline())
        assert address is not None
        print(f"{clip}: the command answers after {time.perf_counter() - began:.2f} s")
        page = browser.new_page(viewport={"width": 1280, "height": 760})
        began = time.perf_counter()
        page.goto(address[0])
        until(page, "window.studio?.begun && [...studio.motions.values()].some((m) => m.there === m.frames)")
        print(f"{clip}: the page shows the whole motion after {time.perf_counter() - began:.2f} s")
        print(f"{clip}: {' and '.join(playing(page))}")
        page.evaluate("() => { studio.view.renderer.render = () => {}; }")
        print(f"{clip}, without three.js's drawing: {' and '.join(playing(page))}")
        page.evaluate("() => { delete studio.view.renderer.render; }")
        if clip == CLIP.name:
            for _ in range(3):
                page.evaluate(_MAKE_A_GAP)
                count = page.evaluate("studio.session.state.results.length")
                page.keyboard.press("f")
                seconds = until(page, f"studio.session.state.results.length > {count}")
                print(f"{clip}: a gap of 2 s is filled and shown after {seconds:.2f} s")
    finally:
        process.kill()
        process.wait()


def main() -> None:
    """Print all figures."""
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    with tempfile.TemporaryDirectory() as place, sync_playwright() as started:
        folder = Path(place)
        shutil.copy(CLIP, folder)
        write_whole(folder / "long.bvh", long_clip())
        browser = started.chromium.launch(executable_path=chromium, args=_FLAGS)
        for clip in (CLIP.name, "long.bvh"):
            measured(folder, clip, browser)
        browser.close()
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")


if __name__ == "__main__":
    main()
