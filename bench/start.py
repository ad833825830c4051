"""Start-up time of `tsd-demo`, compared with an interpreter that imports the libraries."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator

from bench.programs import tool
from bench.table import Row, Run

_IMPORTS = "import viser, zenoh, aiohttp, trimesh, rosbags.typesys"


def rows(run: Run) -> Iterator[Row]:
    """Measure a warm install."""
    yield from run.alternate(["start.demo"], demo_s, imports_s, rounds=3)


def demo_s() -> list[float]:
    """Return the time until the demo is ready."""
    with tempfile.TemporaryDirectory() as folder:
        start_s = time.perf_counter()
        with tool("tsd_demo", "--no-browser", "--record-dir", folder):
            return [time.perf_counter() - start_s]


def imports_s() -> list[float]:
    """Return the time to import the libraries alone."""
    start_s = time.perf_counter()
    subprocess.run([sys.executable, "-c", _IMPORTS], check=True)
    return [time.perf_counter() - start_s]
