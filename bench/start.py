"""Benchmark of the start-up time of `tsd-demo`."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator

from bench.table import Row


def rows(*, smallest: bool = False) -> Iterator[Row]:
    """Measure `tsd-demo` on a warm install, compared with an interpreter with the same imports."""
    demo_s = min(until_ready() for _ in range(1 if smallest else 3))
    code = "import viser, zenoh, aiohttp, trimesh, rosbags.typesys"
    start = time.perf_counter()
    subprocess.run([sys.executable, "-c", code], check=True)
    floor_s = time.perf_counter() - start
    yield Row("tsd-demo ready", demo_s, 5.0, "s", f"importing the libraries alone {floor_s:.2f} s")


def until_ready() -> float:
    """Return the time until the demo is ready."""
    start = time.perf_counter()
    folder = tempfile.TemporaryDirectory()
    demo = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "tsd_demo",
            "--no-browser",
            "--until-eof",
            "--record-dir",
            folder.name,
        ],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert demo.stdout is not None
    for line in demo.stdout:
        if line.startswith("ready:"):
            break
    took_s = time.perf_counter() - start
    demo.communicate(timeout=10)
    folder.cleanup()
    return took_s
