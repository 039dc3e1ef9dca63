"""One error for damaged files, whichever library detects the damage."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pyarrow as pa

from data_schemas.disk import WRITING_FAULTS
from data_schemas.errors import InputError


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Turn the errors that libraries raise on a damaged file into one InputError that names the file.

    Faults of a disk that is written meanwhile pass through.
    """
    try:
        yield
    except InputError:
        raise
    except FileNotFoundError:
        raise InputError(
            f"{path} is missing.", "The artefact is damaged or being replaced: run its stage again."
        ) from None
    except (
        OSError,
        ValueError,
        KeyError,
        TypeError,
        RuntimeError,
        AttributeError,
        MemoryError,
        pa.ArrowException,
    ) as e:
        if isinstance(e, OSError) and e.errno in WRITING_FAULTS:
            raise
        reason = " ".join(str(e).split())[:200]
        raise InputError(
            f"{path} is damaged, or of another kind ({reason}).",
            "`pumps artefact verify` lists the files that have changed; run the stage that made it again.",
        ) from None
