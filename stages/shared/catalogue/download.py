"""Downloads that are resumed after a break, and verified. Pooch stores and verifies the file; resuming is done here.

The downloaded part is kept in `NAME.part`, and the server's identifier of that version of the file (its ETag or date)
in `NAME.part.mark`. A later attempt requests the rest of that version, and starts again if the server has another.
"""

from __future__ import annotations

import shutil
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import pooch
import requests

from data_schemas.disk import cannot_be_written, check_room
from data_schemas.errors import PumpsError, UsageError
from stages.shared.catalogue.catalogue import DataFile
from stages.shared.progress import Progress

_BLOCK = 1 << 16  # most bytes that are lost when a connection breaks
_PATIENCE_S = 30  # a connection without a byte for so long counts as broken
_TRIES = 6  # failures in a row, each without a new byte, before the download is given up
_MOST_UNSTATED = 20 << 30  # most bytes of a file whose size is not published


class _Changed(Exception):
    """The server's file is another version than the downloaded part."""


def fetch_file(
    file: DataFile,
    folder: Path,
    *,
    progress: Progress,
    pause_s: float = 1.0,
    overwrite: bool = False,
    most_bytes: int = _MOST_UNSTATED,
) -> Path:
    """The file in `folder`, downloaded unless it is there completely, and verified by its checksum.

    Args:
        pause_s: wait after the first broken connection, doubled at each further one.
        overwrite: whether a file of this name with another checksum is replaced.
        most_bytes: at which a file whose size is not stated is given up.

    Raises: UsageError if such a file is there and may not be replaced; PumpsError if the server cannot be reached or
        sends something else, or the disk is full. The downloaded part is kept, and the next call continues it (after
        a wrong checksum it starts from the beginning).
    """
    target = folder / file.name
    source = f"; stated by {file.checksum_from}" if file.checksum_from else ""
    check_room(target, file.bytes)
    new_folder = not folder.exists()
    resuming: Any = _Resuming(
        file, target, progress, pause_s, overwrite, most_bytes
    )  # pooch passes these arguments by position
    try:
        folder.mkdir(parents=True, exist_ok=True)
        pooch.get_logger().setLevel("ERROR")
        pooch.retrieve(file.url, file.checksum or None, fname=file.name, path=folder, downloader=resuming)
    except ValueError as error:  # pooch's exception for a wrong checksum
        raise PumpsError(
            f"{file.name} does not match its checksum ({file.checksum}{source}).",
            "Run the command again to download it again; if it fails again, the publisher has changed the file.",
        ) from error
    except OSError as error:
        resuming.forget_nothing()
        if new_folder:
            with suppress(OSError):  # it holds the downloaded part
                folder.rmdir()
        raise cannot_be_written(target, error) from error
    return target


class _Resuming:
    """A downloader for pooch: called with the URL and the file to write."""

    def __init__(
        self, file: DataFile, target: Path, progress: Progress, pause_s: float, overwrite: bool, most_bytes: int
    ):
        self.file, self.progress, self.pause_s = file, progress, pause_s
        self.most_bytes = file.bytes or most_bytes
        self.target, self.overwrite = target, overwrite
        self.part = target.with_name(target.name + ".part")
        self.mark = target.with_name(target.name + ".part.mark")

    def __call__(self, url: str, output_file: str, _pooch: object, check_only: bool = False) -> bool | None:
        if check_only:
            return None
        if self.target.exists() and not self.overwrite:  # pooch found another checksum
            raise UsageError(
                f"{self.target} exists, but does not match the checksum that is stated for it.",
                "Give --overwrite to replace it, or another folder with -o.",
            )
        self.progress.start(f"downloading {self.file.name}", self.file.bytes or None)
        self.progress.advance(self._size())
        failures = 0
        while True:
            before = self._size()
            try:
                self._go_on(url)
                break
            except _Changed:
                self._forget()
                failures += 1
            except (requests.ConnectionError, requests.Timeout, requests.exceptions.ChunkedEncodingError) as error:
                failures = 1 if self._size() > before else failures + 1
                if failures >= _TRIES:
                    raise PumpsError(
                        f"{self.file.name} could not be downloaded: the connection to {url} broke {failures} times.",
                        f"{self._size() / 1e6:.1f} MB are kept; run the command again to continue.",
                    ) from error
                time.sleep(self.pause_s * 2 ** (failures - 1))
            if failures >= _TRIES:
                raise PumpsError(f"{self.file.name} changed on the server during the download.")
        shutil.move(self.part, output_file)
        self.mark.unlink(missing_ok=True)
        return None

    def _size(self) -> int:
        return self.part.stat().st_size if self.part.exists() else 0

    def _forget(self) -> None:
        self.part.unlink(missing_ok=True)
        self.mark.unlink(missing_ok=True)

    def forget_nothing(self) -> None:
        """Remove the files of a download of which no byte is there."""
        if not self._size():
            with suppress(OSError):
                self._forget()

    def _go_on(self, url: str) -> None:
        """Request the missing bytes and append them. Raises requests' exceptions if the connection breaks."""
        have = self._size()
        if have and not self.mark.exists():
            raise UsageError(
                f"{self.part} is not of a download by pumps, and would be removed.",
                "Move it, or give another folder with -o.",
            )
        version = self.mark.read_text() if have else ""
        if have and not version:
            self._forget()  # the version of the part is unknown
            have = 0
        headers = {"Accept-Encoding": "identity"}
        if have:
            headers |= {"Range": f"bytes={have}-", "If-Range": version}
        with requests.get(url, headers=headers, stream=True, timeout=_PATIENCE_S) as answer:
            if have and answer.status_code == 416:
                raise _Changed  # the server has no further bytes, but the file is not complete
            if answer.status_code not in (200, 206):
                raise PumpsError(
                    f"{url} answers {answer.status_code} {answer.reason}.",
                    "Try again later, or download the file by hand from its home page.",
                )
            if answer.status_code == 206 and not answer.headers.get("Content-Range", "").startswith(f"bytes {have}-"):
                raise _Changed
            if answer.status_code == 200 and have:
                self._forget()
                have = 0
            self.mark.write_text(answer.headers.get("ETag") or answer.headers.get("Last-Modified") or "")
            expected = have + int(answer.headers.get("Content-Length") or 0)
            self._append(answer, expected)

    def _append(self, answer: requests.Response, expected: int) -> None:
        with self.part.open("ab") as part:
            for block in answer.iter_content(_BLOCK):
                part.write(block)
                self.progress.advance(len(block))
                if part.tell() > self.most_bytes:
                    part.close()
                    self._forget()
                    raise PumpsError(
                        f"{self.file.name} should have {self.most_bytes:,} bytes at most, but the server sends more.",
                        "The publisher has changed the file; see the home page.",
                    )
            if part.tell() < expected:
                raise requests.ConnectionError("the connection closed before the end")
