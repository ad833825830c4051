"""Attacks by recordings: a page opens damaged files while another presses STOP.

`python -m attack.files --files 1000` prints only the rows of this part, with this number of files.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import re
import secrets
import statistics
import subprocess
import sys
import tempfile
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path

from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from attack.live import behind, program
from attack.table import Row
from tests.support.hostile_recordings import bombs, damaged
from tests.support.page_client import Page
from tests.support.programs import Program
from tests.support.recorded_drives import recorded_circle
from tests.support.robot_node import ANY_PORT, PATIENT
from tsd_twin.bus import Bus, client_config
from tsd_twin.bus.config import as_client
from tsd_twin.errors import RecordingError
from tsd_twin.messages import topics
from tsd_twin.messages.topics import QoS
from tsd_twin.recording.player import Player
from tsd_twin.recording.remote import ReaderProcesses, RemoteFolderReader, RemoteReader

FILES = 1000
WORST = 8
"""Number of damaged files opened by pages, those with the longest reading time."""
DRIVES, PRESSES = 25, 10
GROWTH_MB = 64.0
STOP_MS = 50.0
PLANTED_BYTES = 300_000_000
_WORKERS = 2
_HELD_S = 1.5
"""Time for which a page shows a file."""
LONGEST_S = 300.0
"""Timeout for opening every file at least once."""
SCAN_S = 20.0
"""Two concurrent reads, each limited to 10 s of CPU time per request."""


def rows(files: int = FILES) -> Iterator[Row]:
    """Yield one row per attack."""
    with tempfile.TemporaryDirectory() as place, ExitStack() as stack:
        folder = Path(place, "recordings")
        folder.mkdir()
        honest = recorded_circle(folder / "honest.mcap", 6)
        robot = Path(place, "patient.toml")
        robot.write_text(PATIENT, encoding="utf-8")
        mock = stack.enter_context(program("tsd_mock", "--listen", ANY_PORT, "--robot", str(robot)))
        (endpoint,) = re.findall(r"tcp/[\d.:]+", mock.ready())
        yield from planted(endpoint, folder)
        named = bombs(honest, folder)
        took_s, refused = scanned(honest, folder, files)
        worst = sorted(took_s, key=lambda path: took_s[path])[-WORST:]
        yield Row(
            f"{files} damaged recordings, read as a page does",
            f"< {SCAN_S:g} s each",
            f"{refused} refused, worst {took_s[worst[-1]]:.1f} s" if worst else "none",
            all(taken_s < SCAN_S for taken_s in took_s.values()),
            size=max(took_s.values(), default=0.0),
        )
        for path in took_s.keys() - set(worst):
            path.unlink()
        yield from opened(endpoint, folder, [honest, *named.values(), *worst])


def planted(endpoint: str, folder: Path) -> Iterator[Row]:
    """Send one message of 300 MB to a robot whose bus is recorded."""
    flags = ("--connect", endpoint, "--dir", str(folder))
    with program("tsd_record", *flags) as recorder, Bus(client_config([endpoint])) as bus:
        recorder.ready()
        bus.wait_for_peer(10.0)
        before_mb = peak_mb(recorder)
        publisher = bus.publisher(topics.STATUS.key("tsd"), QoS.DATA)
        publisher.put(bytes(PLANTED_BYTES))
        bus.publisher(topics.event_key("tsd", "x"), QoS.DATA).put(bytes(PLANTED_BYTES))
        time.sleep(5.0)
        grown_mb = peak_mb(recorder) - before_mb
    yield Row(
        "two messages of 300 MB on a bus that is recorded",
        f"recorder <= {GROWTH_MB:g} MB",
        f"{grown_mb:.0f} MB",
        grown_mb <= GROWTH_MB,
        size=grown_mb,
    )


def peak_mb(started: Program) -> float:
    """Return the peak memory of a process."""
    status = Path(f"/proc/{started.process.pid}/status").read_text("ascii")
    (line,) = (line for line in status.splitlines() if line.startswith("VmHWM:"))
    return int(line.split()[1]) / 1e3


def forget_peak(started: Program) -> None:
    """Reset the peak of `peak_mb`."""
    Path(f"/proc/{started.process.pid}/clear_refs").write_text("5", "ascii")


def scanned(honest: Path, folder: Path, files: int) -> tuple[dict[Path, float], int]:
    """Make damaged files; return the reading time of each, and the number of rejected ones."""
    processes, refused = ReaderProcesses(), list[Path]()

    def scan(seed: int) -> tuple[Path, float]:
        path = damaged(honest, folder / f"damaged{seed}.mcap", seed)
        start_s = time.monotonic()
        try:
            read(path, processes)
        except RecordingError:
            refused.append(path)
        return path, time.monotonic() - start_s

    with contextlib.closing(processes), ThreadPoolExecutor(_WORKERS) as workers:
        return dict(workers.map(scan, range(files))), len(refused)


def read(path: Path, processes: ReaderProcesses) -> None:
    """Read a file like a page.

    Raises:
        RecordingError: If the file is rejected.
    """
    with contextlib.closing(RemoteFolderReader(processes)) as folder:
        folder.listing(path)
    with contextlib.closing(Player(path, reader=RemoteReader(path, processes))) as player:
        player.reader.events()
        for i in range(5):
            player.seek(player.duration_s * i / 4)


def opened(endpoint: str, folder: Path, files: list[Path]) -> Iterator[Row]:
    """Open the files in a page, one after the other, while another page presses STOP."""
    flags = ("--port", "0", "--connect", endpoint, "--record-dir", str(folder))
    with program("tsd_dashboard", *flags) as started, StopWatch(endpoint) as watch:
        port = int(re.findall(r"http://\S+?:(\d+)", started.ready())[0])
        page = Page(port, secrets.token_hex(8))
        try:
            page.make_ready()
            calm_ms = presses(page, watch, 2)
            forget_peak(started)
            before_mb = peak_mb(started)
            opener = subprocess.Popen(
                [sys.executable, "-m", "attack.files", "--open", str(port), *map(str, files)],
                stdout=subprocess.PIPE,
                text=True,
            )
            shown = list[str]()
            reader = threading.Thread(target=shown.extend, args=(opener.stdout or (),))
            reader.start()
            took_ms, start_s = presses(page, watch, DRIVES), time.monotonic()
            while len(shown) < len(files) and time.monotonic() < start_s + LONGEST_S:
                took_ms += presses(page, watch, 1)  # Each file is opened at least once.
            opener.terminate()
            opener.wait()
            reader.join()
        finally:
            page.close()
        grown_mb = peak_mb(started) - before_mb
    p99 = sorted(took_ms)[-1 - len(took_ms) // 100]
    yield Row(
        f"{len(files)} of the worst opened, STOP elsewhere",
        f"at the robot p99 <= {STOP_MS:g} ms",
        f"p50 {statistics.median(took_ms):.0f}, p99 {p99:.0f}, most {max(took_ms):.0f} ms of "
        f"{len(took_ms)} (calm p50 {statistics.median(calm_ms):.0f}, most {max(calm_ms):.0f}), "
        f"{len(set(shown))} files opened {len(shown)} times",
        p99 <= STOP_MS and len(set(shown)) == len(files),
        size=p99,
    )
    yield Row(
        "the same: memory of the dashboard",
        f"grows by < {GROWTH_MB:g} MB",
        f"{grown_mb:.0f} MB",
        grown_mb < GROWTH_MB,
        size=grown_mb,
    )


class StopWatch:
    """Client on a robot's bus that receives each STOP at the same time as the robot."""

    def __init__(self, endpoint: str) -> None:
        self._bus = Bus(as_client(client_config([endpoint]), 10.0))
        self._seen = threading.Event()
        self._at_s = 0.0
        self._bus.subscribe(topics.STOP.key(behind(endpoint).id), self._take)

    def __enter__(self) -> StopWatch:
        return self

    def __exit__(self, *_: object) -> None:
        self._bus.close()

    def _take(self, _sample: object) -> None:
        if not self._seen.is_set():
            self._at_s = time.monotonic()
            self._seen.set()

    def press_ms(self, page: Page) -> float:
        """Press STOP in a page; return the time until it arrives at the robot."""
        before = len(page.all("reply"))
        self._seen.clear()
        start_s = time.monotonic()
        page.send(t="stop")
        if not self._seen.wait(30.0):
            return float("inf")
        page.until(lambda: page.all("reply")[before:])
        page.messages[:] = page.messages[-50:]
        return 1e3 * (self._at_s - start_s)


def presses(page: Page, watch: StopWatch, drives: int) -> list[float]:
    """Drive, and press STOP several times; return the times."""
    took_ms: list[float] = []
    for _ in range(drives):
        page.make_ready()
        page.drive(0.2)
        for _ in range(PRESSES):
            took_ms.append(watch.press_ms(page))
            time.sleep(0.05)
        page.let_go()
        time.sleep(0.6)  # A reset is refused for 0.5 s.
    return took_ms


def open_pages(port: int, names: list[str]) -> None:
    """Open each file like a page, repeatedly; print a line for each."""
    while True:
        for name in names:
            for path in ("recordings", f"recordings/{name}/path"):
                with contextlib.suppress(urllib.error.URLError, TimeoutError):
                    urllib.request.urlopen(f"http://127.0.0.1:{port}/{path}", timeout=60.0).read()
            page = secrets.token_hex(8)
            with contextlib.suppress(InvalidStatus, ConnectionClosed, OSError, EOFError):
                show(port, page, name)
            sys.stdout.write(f"{name}\n")
            sys.stdout.flush()


def show(port: int, page: str, name: str) -> None:
    """Show a file in both sockets of a page, and seek in it."""
    query = f"page={page}&recording={name}"
    session = connect(f"ws://127.0.0.1:{port}/teleop?{query}", open_timeout=30.0, max_size=None)
    with (
        session,
        connect(
            f"ws://127.0.0.1:{port}/recorded/{name}/{page}",
            subprotocols=[Subprotocol("viser-v1.1.1")],
            open_timeout=30.0,
            max_size=None,
        ),
    ):
        end_s = time.monotonic() + _HELD_S
        session.send(json.dumps({"t": "play", "speed": 4.0}))
        while (left_s := end_s - time.monotonic()) > 0:
            with contextlib.suppress(TimeoutError):
                session.recv(timeout=left_s)


def main() -> None:
    """Print the rows, or run as the other page."""
    parser = argparse.ArgumentParser(prog="python -m attack.files")
    parser.add_argument("--files", type=int, default=FILES, help="damaged files")
    parser.add_argument("--open", nargs="+", metavar="PORT FILE", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.open:
        open_pages(int(args.open[0]), [Path(each).name for each in args.open[1:]])
        return
    held = True
    for row in rows(args.files):
        print(row, flush=True)
        held &= row.held
    sys.exit(0 if held else 1)


if __name__ == "__main__":
    main()
