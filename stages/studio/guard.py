"""Checks of every request, and headers of every answer.

The server listens on the loopback interface, which any program and any web page on the machine can reach. Four rules
keep them out: the address holds a random token; the Host header names this server, so that another name that leads
here (DNS rebinding) is refused; a request that another origin's page sends is refused; bodies are bounded.
"""

from __future__ import annotations

import secrets
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

MOST_BYTES = 256 << 20  # of a file that is dropped on the page
MOST_JSON_BYTES = 4 << 20  # of any other body
UPLOADS = "/api/upload"  # the end of the one path that takes files
_CHANGING = ("POST", "PUT", "DELETE", "PATCH")
_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_HEADERS = [
    (b"content-security-policy", _POLICY.encode()),
    (b"referrer-policy", b"no-referrer"),
    (b"x-content-type-options", b"nosniff"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cache-control", b"no-store"),
]


def new_token() -> str:
    """A random text of 32 characters (192 bits)."""
    return secrets.token_urlsafe(24)


class Guard:
    """An ASGI application that hands allowed requests on, with the token taken from the path."""

    def __init__(self, app: App, token: str, port: int) -> None:
        self._app, self._token = app, token
        self._hosts = {f"127.0.0.1:{port}", f"localhost:{port}"}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            return  # no sockets, and no start or end to announce
        headers = {name.decode("latin-1").lower(): value.decode("latin-1") for name, value in scope["headers"]}
        refused = self._refusal(scope, headers)
        if refused is not None:
            await _answer(send, *refused)
            return
        inner = scope["path"][len(self._token) + 1 :]
        most = MOST_BYTES if inner.endswith(UPLOADS) else MOST_JSON_BYTES
        if not headers.get("content-length", "0").isdecimal() or int(headers.get("content-length", "0")) > most:
            await _answer(send, 413, "The body is too large.")
            return
        passed = 0

        async def bounded() -> MutableMapping[str, Any]:
            nonlocal passed
            message = await receive()
            passed += len(message.get("body", b""))
            if passed > most:  # a body in chunks states no length
                return {"type": "http.disconnect"}
            return message

        async def with_headers(message: MutableMapping[str, Any]) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message.get("headers", []), *_HEADERS]
            await send(message)

        path = inner or "/"
        await self._app({**scope, "path": path, "raw_path": path.encode(), "root_path": ""}, bounded, with_headers)

    def _refusal(self, scope: Scope, headers: dict[str, str]) -> tuple[int, str] | None:
        """The status and the sentence with which a request is refused; None where it may pass."""
        host = headers.get("host", "")
        if host not in self._hosts:
            return 403, "This server is called 127.0.0.1."
        origin = headers.get("origin")
        if origin is not None and origin != f"http://{host}":
            return 403, "Pages of other origins are refused."
        if origin is None and scope["method"] in _CHANGING:
            return 403, "A request that changes something names its origin."
        if headers.get("sec-fetch-site", "none") not in ("none", "same-origin") and not _leads_here(scope, headers):
            return 403, "Pages of other origins are refused."
        given = scope["path"].split("/")[1] if scope["path"].startswith("/") else ""
        if not secrets.compare_digest(given.encode(), self._token.encode()):
            return 404, "There is nothing here."
        return None


def _leads_here(scope: Scope, headers: dict[str, str]) -> bool:
    """Whether a browser asks for the page itself, in a window of its own, as the file that opens it makes it do."""
    is_page = scope["method"] == "GET" and scope["path"].count("/") == 2 and scope["path"].endswith("/")
    return is_page and (headers.get("sec-fetch-mode"), headers.get("sec-fetch-dest")) == ("navigate", "document")


async def _answer(send: Send, status: int, sentence: str) -> None:
    headers = [(b"content-type", b"text/plain; charset=utf-8"), (b"connection", b"close"), *_HEADERS]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": sentence.encode()})
