"""Opening the page in the browser without its token in a command line, which every user of the machine can list."""

from __future__ import annotations

import os
import tempfile
import threading
import webbrowser
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from stages.shared.markup import markup


@contextmanager
def opened_page(address: str, folder: Path) -> Iterator[Path]:
    """Open an address in the browser by a file that leads there, which only this user can read.

    Args:
        folder: where the file lies until the context ends.
    """
    handle, name = tempfile.mkstemp(prefix="open-", suffix=".html", dir=folder)  # of mode 0600
    page = Path(name)
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(
                markup(
                    '<!doctype html><meta charset="utf-8"><meta name="referrer" content="no-referrer">'
                    '<meta http-equiv="refresh" content="0; url={}"><title>pumps studio</title>'
                    '<p><a href="{}">Open the studio</a></p>\n', address, address,
                )
            )  # fmt: skip
        threading.Thread(target=webbrowser.open, args=(page.as_uri(),), daemon=True).start()
        yield page
    finally:
        page.unlink(missing_ok=True)
