"""Keep what a visit has taken from staying in the heap in pieces."""

from __future__ import annotations

import ctypes

_M_MMAP_THRESHOLD = -3
"""From glibc's `malloc.h`."""
_MAPPED_FROM_BYTES = 65536


def return_large_blocks() -> bool:
    """Let glibc give blocks of 64 KiB and more back to the system as soon as they are freed.

    Each page that opens makes the dashboard take and free many of them. glibc raises its own bound
    between heap and maps, up to 32 MiB, to the size of whatever is freed; blocks below it then come
    from heaps of many threads, in the holes between what stays, and a day of visits leaves a heap
    of holes: memory that nobody holds, and nobody gets back. A bound that is set is not raised.

    Returns:
        Whether the C library took it; one that is not glibc needs none of this.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    return mallopt is not None and mallopt(_M_MMAP_THRESHOLD, _MAPPED_FROM_BYTES) == 1
