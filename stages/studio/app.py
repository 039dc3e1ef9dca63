"""The page's addresses: each request is handed to the bench and answered with JSON or bytes."""

from __future__ import annotations

import json
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from pydantic import ValidationError
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Route

from data_schemas.errors import InputError, PumpsError, UsageError
from stages.studio.bench import Bench
from stages.studio.guard import App, Guard
from stages.studio.opening import SeveralClipsError
from stages.studio.session import OutOfDateError

ASSETS = Path(__file__).resolve().parent / "assets"
_TYPES = {".html": "text/html", ".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}
_FILES = {path.relative_to(ASSETS).as_posix(): path for path in ASSETS.rglob("*") if path.suffix in _TYPES}

Answer = Callable[[dict[str, Any]], Any]  # what the body and the path say -> plain data


def guarded_app(
    bench: Bench, token: str, port: int, first: str = "", shown: Callable[[], None] = lambda: None
) -> App:
    """The application.

    Args:
        first: the recording that a new page opens, a name in the folder. shown: called when a page has got a motion.
    """

    def session(asked: dict[str, Any]) -> dict[str, Any]:
        return bench.shown(bench.sessions.load(asked["session"]))

    def start(asked: dict[str, Any]) -> dict[str, Any]:
        about = {"first": first, "weights": bench.weights, "folder": bench.folder.path.name}
        return {**about, "bodies": find_spec("anny") is not None}

    def opened(asked: dict[str, Any]) -> dict[str, Any]:
        about = _place(asked) if "session" in asked else (None, None)
        return bench.shown(
            bench.open_file(_text(asked, "file"), *about, bool(asked.get("aside")), str(asked.get("clip", "")))
        )

    def settings(asked: dict[str, Any]) -> dict[str, Any]:
        given = _field(asked, "settings", dict)
        return bench.shown(bench.set_settings(*_place(asked), _text(asked, "label"), given))

    def history(asked: dict[str, Any]) -> dict[str, Any]:
        steps = {"undo": -1, "redo": 1}.get(_text(asked, "move"))
        if steps is None:
            raise UsageError("A move is undo or redo.")
        return bench.shown(bench.move(*_place(asked), steps))

    def choose(asked: dict[str, Any]) -> dict[str, Any]:
        return bench.shown(bench.choose(*_place(asked), _text(asked, "motion")))

    def discard(asked: dict[str, Any]) -> dict[str, Any]:
        return bench.shown(bench.discard(*_place(asked), _text(asked, "motion")))

    def fill(asked: dict[str, Any]) -> dict[str, Any]:
        return bench.fill(asked["session"], _field(asked, "samples", int)).plain()

    def edit(asked: dict[str, Any]) -> dict[str, Any]:
        options = _field(asked, "options", dict)
        return bench.edit(asked["session"], _text(asked, "verb"), options, str(asked.get("other", ""))).plain()

    def job(asked: dict[str, Any]) -> dict[str, Any]:
        return bench.jobs.named(asked["session"], asked["job"]).plain()

    def cancel(asked: dict[str, Any]) -> dict[str, Any]:
        found = bench.jobs.named(asked["session"], asked["job"])
        bench.jobs.cancel(found)
        return found.plain()

    def saved(asked: dict[str, Any]) -> dict[str, Any]:
        place = asked["session"], _text(asked, "motion"), _text(asked, "name"), bool(asked.get("overwrite"))
        return bench.save(*place)

    def scene(asked: dict[str, Any]) -> dict[str, Any]:
        return bench.scene(asked["session"], asked["motion"]).description

    def points(asked: dict[str, Any]) -> bytes:
        found = bench.scene(asked["session"], asked["motion"]).points
        shown()
        return found

    def plain(asked: dict[str, Any]) -> dict[str, Any]:
        return bench.plain_scene(asked["session"]).description

    def plain_points(asked: dict[str, Any]) -> bytes:
        return bench.plain_scene(asked["session"]).points

    def surface(asked: dict[str, Any]) -> bytes:
        return bench.surface(asked["session"], asked["motion"])

    here = "/api/sessions/{session}"
    routes = [
        Route("/", _page),
        Route("/assets/{name:path}", _asset),
        _route("/api/start", start),
        _route("/api/files", lambda asked: bench.folder.recordings()),
        _route("/api/sessions", lambda asked: bench.sessions.recent()),
        _route("/api/open", opened, "POST"),
        Route("/api/upload", _upload(bench), methods=["POST"]),
        _route(here, session),
        _route(f"{here}/settings", settings, "PUT"),
        _route(f"{here}/history", history, "POST"),
        _route(f"{here}/choose", choose, "POST"),
        _route(f"{here}/discard", discard, "POST"),
        _route(f"{here}/fill", fill, "POST"),
        _route(f"{here}/edit", edit, "POST"),
        _route(f"{here}/save", saved, "POST"),
        _route(f"{here}/jobs/{{job}}", job),
        _route(f"{here}/jobs/{{job}}", cancel, "DELETE"),
        _route(f"{here}/plain", plain),
        _route(f"{here}/plain/points", plain_points),
        _route(f"{here}/motions/{{motion}}", scene),
        _route(f"{here}/motions/{{motion}}/points", points),
        _route(f"{here}/motions/{{motion}}/surface", surface),
    ]
    return Guard(Starlette(routes=routes), token, port)  # type: ignore[arg-type]


def _route(path: str, answer: Answer, method: str = "GET") -> Route:
    async def endpoint(request: Request) -> Response:
        try:
            body = {} if method in ("GET", "DELETE") else await _body(request)
            made = await run_in_threadpool(answer, {**body, **request.path_params})
        except Exception as error:
            return _fault(error)
        if isinstance(made, bytes):
            return Response(made, media_type="application/octet-stream")
        return _AsciiJson(made)

    return Route(path, endpoint, methods=[method])


def _upload(bench: Bench) -> Callable[[Request], Any]:
    async def endpoint(request: Request) -> Response:
        try:
            asked = dict(request.query_params)
            data = await request.body()
            revision = int(asked["revision"]) if "revision" in asked else None
            about = asked.get("session"), revision, asked.get("aside") == "1", asked.get("clip", "")
            opened = await run_in_threadpool(bench.open_bytes, asked.get("name", ""), data, *about)
        except Exception as error:
            return _fault(error)
        return _AsciiJson(bench.shown(opened))

    return endpoint


class _AsciiJson(JSONResponse):
    """JSON that escapes all but ASCII, so that it can hold a name of a file that is no UTF-8."""

    def render(self, content: Any) -> bytes:
        return json.dumps(content, allow_nan=False, separators=(",", ":")).encode()


async def _body(request: Request) -> dict[str, Any]:
    if request.headers.get("content-type", "").partition(";")[0] != "application/json":
        raise UsageError("The body is no JSON.")
    found = await request.json()
    if not isinstance(found, dict):
        raise UsageError("The body is no JSON object.")
    return found


def _fault(error: Exception) -> Response:
    """The answer for an error of the user's or the page's: one sentence. Raises others, which the server logs."""
    if isinstance(error, ClientDisconnect):
        return JSONResponse({"error": "The body is too large."}, 413)
    if isinstance(error, ValidationError):
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))
        return JSONResponse({"error": f"{place}: {first['msg']}."}, 400)
    if isinstance(error, ValueError):  # no JSON, or no number
        return JSONResponse({"error": "The request cannot be read."}, 400)
    if not isinstance(error, PumpsError):
        raise error
    if isinstance(error, SeveralClipsError):  # the page asks which, and opens that one
        return _AsciiJson({"clips": error.clips, "told": str(error)})
    status = 409 if isinstance(error, OutOfDateError) else 404 if isinstance(error, InputError) else 400
    return _AsciiJson({"error": str(error)}, status)


def _place(asked: dict[str, Any]) -> tuple[str, int]:
    return _text(asked, "session"), _field(asked, "revision", int)


def _text(asked: dict[str, Any], name: str) -> str:
    return _field(asked, name, str)


def _field(asked: dict[str, Any], name: str, kind: type) -> Any:
    value = asked.get(name)
    if not isinstance(value, kind) or (kind is int and isinstance(value, bool)):
        raise UsageError(f"The request has no {name}.")
    return value


async def _page(request: Request) -> Response:
    return FileResponse(_FILES["studio.html"], media_type="text/html")


async def _asset(request: Request) -> Response:
    path = _FILES.get(request.path_params["name"])
    if path is None:
        return Response("There is nothing here.", 404)
    return FileResponse(path, media_type=_TYPES[path.suffix])
