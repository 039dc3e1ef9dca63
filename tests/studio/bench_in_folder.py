"""A bench in a folder of its own, and a client that asks as the page does."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from starlette.testclient import TestClient

from stages.shared.weights.shipped import default_weights
from stages.studio.app import guarded_app
from stages.studio.bench import Bench
from stages.studio.folder import Folder

CLIPS = Path(__file__).resolve().parents[2] / "stages" / "shared" / "clips"
PORT, TOKEN = 8765, "a-token"
HERE = f"http://127.0.0.1:{PORT}"


class Page:
    """What a page can ask of a bench."""

    def __init__(self, bench: Bench, first: str = "") -> None:
        self.bench = bench
        self.client = TestClient(guarded_app(bench, TOKEN, PORT, first), base_url=HERE, headers={"origin": HERE})

    def ask(self, path: str, method: str = "GET", body: Any = None, status: int = 200) -> Any:
        answer = self.client.request(method, f"/{TOKEN}/api/{path}", json=body)
        assert answer.status_code == status, answer.text
        return answer.json()

    def post(self, session: dict[str, Any], path: str, status: int = 200, **body: Any) -> Any:
        about = {"revision": session["revision"], **body}
        return self.ask(f"sessions/{session['id']}/{path}", "POST", about, status)

    def settings(self, session: dict[str, Any], status: int = 200, **constraints: Any) -> Any:
        settings = session["state"]["settings"]
        body = {
            "revision": session["revision"], "label": "Changed",
            "settings": {**settings, "constraints": {**settings["constraints"], **constraints}},
        }  # fmt: skip
        return self.ask(f"sessions/{session['id']}/settings", "PUT", body, status)

    def wait(self, job: dict[str, Any]) -> dict[str, Any]:
        """The job when it has ended."""
        for _ in range(6000):
            job = self.ask(f"sessions/{job['session']}/jobs/{job['id']}")
            if job["state"] not in ("waiting", "running"):
                return job
            time.sleep(0.02)
        raise AssertionError(f"the job did not end: {job}")

    def session(self, session: dict[str, Any]) -> dict[str, Any]:
        return self.ask(f"sessions/{session['id']}")


@contextmanager
def bench_in(folder: Path, *clips: str) -> Iterator[Bench]:
    """A bench whose folder holds these clips."""
    folder.mkdir(exist_ok=True)
    for clip in clips:
        shutil.copy(CLIPS / f"{clip}.bvh", folder)
    bench = Bench(Folder(folder), default_weights(), "cpu")
    try:
        yield bench
    finally:
        bench.close()
