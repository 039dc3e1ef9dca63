"""`pumps studio`: a page on this machine. It runs until it is interrupted."""

from __future__ import annotations

import socket
from contextlib import nullcontext
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from data_schemas.errors import PumpsError, UsageError
from stages.shared.contract import StageReport
from stages.shared.formats.archives import archive_and_member
from stages.shared.progress import SILENT, Progress
from stages.shared.weights.shipped import SHIPPED, weights_folder
from stages.studio.config import Config
from stages.studio.folder import SESSIONS, Folder

ADDRESS = "127.0.0.1"


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Serve the page until an interrupt.

    Raises: UsageError where the extra `studio` is not installed, or the recording is not in the folder; InputError
        for a folder or weights that are not there; PumpsError for a port that is taken.
    """
    if not all(find_spec(name) for name in ("starlette", "uvicorn")):
        raise UsageError(
            "The studio needs Starlette and uvicorn.", "Install them with `pip install 'pumps[studio]'`."
        )
    folder, first = _places(config)
    weights = _weights(config.weights)
    with _listening(config.port) as listening:
        port = listening.getsockname()[1]
        _serve(config, weights, folder, first, listening, port, progress)
    lines = [f"The studio is closed. Its sessions are in {folder.path / SESSIONS}."]
    return StageReport(lines=lines, figures={"port": port})


def _places(config: Config) -> tuple[Folder, str]:
    """The folder, and the recording's name in it."""
    if config.input is None:
        return Folder(config.folder or Path()), ""
    archive = archive_and_member(str(config.input))[0] or str(config.input)
    given = Path(archive).resolve()
    folder = Folder(config.folder or given.parent)
    if not given.is_relative_to(folder.path):
        raise UsageError(f"{config.input} is not in {folder.path}.", "Name a --folder that holds it.")
    name = given.relative_to(folder.path).as_posix() + str(config.input)[len(archive) :]
    folder.recording(name)
    return folder, name


def _weights(named: str) -> str:
    """Weights by their shipped name, or by their whole path, so that saved commands find them from the folder."""
    found = weights_folder(named)
    return named if found == SHIPPED / named else str(found.resolve())


def _listening(port: int) -> socket.socket:
    found = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        found.bind((ADDRESS, port))
    except OSError as error:
        found.close()
        raise PumpsError(f"Port {port} cannot be used: {error.strerror}.", "Give another --port, or none.") from None
    return found


def _serve(
    config: Config,
    weights: str,
    folder: Folder,
    first: str,
    listening: socket.socket,
    port: int,
    progress: Progress,
) -> None:
    import uvicorn

    from stages.studio.app import guarded_app
    from stages.studio.bench import Bench
    from stages.studio.guard import new_token
    from stages.studio.opened_page import opened_page

    token = new_token()
    bench = Bench(folder, weights, config.device)
    settings: dict[str, Any] = {
        "log_level": "warning", "access_log": False, "server_header": False, "lifespan": "off", "ws": "none",
        "proxy_headers": False, "timeout_graceful_shutdown": 1, "limit_concurrency": 64,
    }  # fmt: skip
    server = uvicorn.Server(uvicorn.Config(guarded_app(bench, token, port, first, bench.warm), **settings))
    address = f"http://{ADDRESS}:{port}/{token}/"
    progress.message(f"The studio is open at {address}\nInterrupt it (Ctrl-C) to close it; nothing is lost.")
    try:
        with opened_page(address, folder.sessions()) if config.browser else nullcontext():
            server.run(sockets=[listening])
    except KeyboardInterrupt:
        pass  # uvicorn raises the interrupt again when it has closed
    finally:
        bench.close()
