"""How the C library gives out memory. Imports no torch; to be called before there are large arrays."""

from __future__ import annotations

import os
import sys

# glibc's settings: names in the environment, numbers for `mallopt` (malloc.h), values in bytes. A block of at least
# the first size gets a mapping of its own (2^25 is the largest value that all versions accept). Free memory at the
# end of the heap is given back to the system when it is larger than the second.
_SETTINGS = {"MALLOC_MMAP_THRESHOLD_": (-3, 2**25), "MALLOC_TRIM_THRESHOLD_": (-1, 2**28)}


def keep_freed_memory() -> None:
    """Let this process, and those that it starts, use freed memory again, unless the environment says otherwise.

    By default glibc gives blocks of a few MiB back to the system as soon as they are free, and asks for them again.
    The system then clears every page anew, which was an eighth of the time of a fill (docs/performance.md). At most
    256 MiB are kept, which were in use before, so the peak does not rise. Other C libraries are left as they are.
    """
    has_settings = any(name.startswith("MALLOC_") for name in os.environ) or "malloc" in os.environ.get(
        "GLIBC_TUNABLES", ""
    )
    if sys.platform != "linux" or has_settings:
        return
    import ctypes  # here: its import takes milliseconds, which the other cases need not pay

    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)  # musl has none
    for name, (number, value) in _SETTINGS.items():
        os.environ[name] = str(value)
        if mallopt is not None:
            mallopt(number, value)
