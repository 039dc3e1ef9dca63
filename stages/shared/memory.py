"""How the C library gives out memory. Imports no torch; to be called before there are large arrays."""

from __future__ import annotations

import os
import sys

# glibc's settings: names in the environment, numbers for `mallopt` (malloc.h), values in bytes. Blocks from the first
# size on are mapped by themselves (the largest that all versions take); more free bytes at the end of the heap than
# the second are given back to the system.
_SETTINGS = {"MALLOC_MMAP_THRESHOLD_": (-3, 2**25), "MALLOC_TRIM_THRESHOLD_": (-1, 2**28)}


def keep_freed_memory() -> None:
    """Let this process, and those that it starts, use freed memory again, unless the environment says otherwise.

    By default glibc gives blocks of a few MiB back to the system as soon as they are free, and asks for them again.
    The system then clears every page anew, which was an eighth of the time of a fill (docs/performance.md). At most
    256 MiB are kept, which were in use before, so the peak does not rise. Other C libraries are left as they are.
    """
    told = any(name.startswith("MALLOC_") for name in os.environ) or "malloc" in os.environ.get("GLIBC_TUNABLES", "")
    if sys.platform != "linux" or told:
        return
    import ctypes  # here, since it takes longer than this function

    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)  # musl has none
    for name, (number, value) in _SETTINGS.items():
        os.environ[name] = str(value)
        if mallopt is not None:
            mallopt(number, value)
