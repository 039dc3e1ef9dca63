"""File names made from names that a file or an archive holds, such as a clip's.

Every name that becomes a part of a path goes through `FileNames`: the result is one plain part that cannot lead out
of its folder, and that Linux, macOS and Windows all take.
"""

from __future__ import annotations

import hashlib
import unicodedata
from itertools import count

LONGEST_BYTES = 120  # of a name in UTF-8, so that suffixes and the names of drafts fit into the 255 of most systems
_REPLACED = frozenset('/\\:*?"<>|')
_RESERVED = frozenset(
    ["con", "prn", "aux", "nul", "conin$", "conout$"]
    + [f"{device}{number}" for device in ("com", "lpt") for number in "0123456789¹²³"]
)  # Windows opens a device by these names, whatever suffix follows


class FileNames:
    """The file names of one folder, no two of which are the same file.

    A name that can be a file's stays as it is. In any other, characters that cannot stand in it become `_`, and eight
    hexadecimal digits of the name's SHA-256 follow, so that names that differ only there stay apart. They follow too
    where an earlier name differs by upper and lower case, or by how accents are encoded, alone: many file systems
    take the two for one.
    """

    def __init__(self) -> None:
        self._by_name: dict[str, str] = {}
        self._taken: set[str] = set()

    def of(self, name: str) -> str:
        """The file name, without suffix, of what is called `name`; the same name always gets the same."""
        if name not in self._by_name:
            plain = _plain(name)
            with_digits = (f"{_cut(plain, LONGEST_BYTES - 9)}-{_digits(name, attempt)}" for attempt in count())
            found = plain if plain == name else next(with_digits)
            while folded(found) in self._taken:
                found = next(with_digits)
            self._taken.add(folded(found))
            self._by_name[name] = found
        return self._by_name[name]


def is_file_name(name: str) -> bool:
    """Whether a name can be a file's as it is."""
    return _plain(name) == name


def _plain(name: str) -> str:
    """One part of a path: nothing unprintable, no separator, no dot before, no dot or space behind, not too long."""
    kept = "".join(each if each.isprintable() and each not in _REPLACED else "_" for each in name)
    if kept.startswith((".", " ")):
        kept = f"_{kept[1:]}"
    if kept.endswith((".", " ")):
        kept = f"{kept[:-1]}_"
    if kept.split(".")[0].rstrip().lower() in _RESERVED:
        kept = f"_{kept}"
    return _cut(kept, LONGEST_BYTES) or "_"


def _cut(text: str, most: int) -> str:
    """The beginning of a text that has at most so many bytes in UTF-8."""
    return text.encode("utf-8")[:most].decode("utf-8", errors="ignore")


def folded(name: str) -> str:
    """What is equal for names or paths that are one file on systems that ignore case or how accents are encoded."""
    return unicodedata.normalize("NFC", unicodedata.normalize("NFD", name).casefold())


def _digits(name: str, attempt: int) -> str:
    text = name if not attempt else f"{name}\0{attempt}"
    return hashlib.sha256(text.encode("utf-8", errors="surrogatepass")).hexdigest()[:8]
