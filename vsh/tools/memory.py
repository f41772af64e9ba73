"""How much memory there is."""

from __future__ import annotations

import os
from contextlib import suppress
from typing import Any

resource: Any
try:
    import resource
except ImportError:  # Windows
    resource = None

GIB = 2**30


def free_memory() -> float:
    """Bytes that this process may still use: what the machine has left, and what a limit on the process leaves.

    Examples
    --------
    >>> free_memory() > 0
    True
    """
    found = [float("inf")]
    with suppress(OSError, ValueError):  # Linux counts what it could let go of as well
        with open("/proc/meminfo", encoding="ascii") as file:
            lines = dict(line.split(":") for line in file)
        found.append(1024.0 * int(lines["MemAvailable"].split()[0]))
    with suppress(AttributeError, ValueError, OSError):  # others tell no more than what they have
        if len(found) == 1:
            found.append(float(os.sysconf("SC_PHYS_PAGES")) * os.sysconf("SC_PAGE_SIZE"))
    found.append(_left_of_limit())
    return min(found)


def _left_of_limit():
    if resource is None:
        return float("inf")
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit == resource.RLIM_INFINITY:
        return float("inf")
    try:
        with open("/proc/self/statm", encoding="ascii") as file:
            used = int(file.read().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        used = 0
    return max(0.0, float(limit - used))
