"""Settings of glibc's malloc, for programs that run for weeks."""

from __future__ import annotations

import ctypes

_M_MMAP_THRESHOLD, _M_ARENA_MAX = -3, -8
"""From glibc's `malloc.h`."""
_MMAP_THRESHOLD_BYTES = 65536


def tune_malloc(*, heaps: int | None = None) -> bool:
    """Return blocks of 64 KiB and more to the system as soon as they are freed.

    Each page that opens makes the dashboard allocate and free many of them. By default, glibc
    raises its threshold between heap and maps, up to 32 MiB, to the size of each freed block.
    Smaller blocks then come from the heaps of many threads, between blocks that stay, and a day of
    visits leaves a fragmented heap that is never returned. A threshold that is set is not raised.

    Args:
        heaps: Maximum number of heaps that threads share; by default eight for each core. Call
            this before the threads start.

    Returns:
        Whether the C library accepted the settings; false without glibc, which does not need them.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    settings = {_M_MMAP_THRESHOLD: _MMAP_THRESHOLD_BYTES}
    if heaps is not None:
        settings[_M_ARENA_MAX] = heaps
    return mallopt is not None and all(mallopt(*each) == 1 for each in settings.items())
