"""Recorder compared with a bare subscriber, completeness of its files, and its effect on a robot.

`python -m bench.recording --seconds 3600` records for an hour and `--kills 20` kills a recorder 20
times.
"""

from __future__ import annotations

import argparse
import base64
import contextlib
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Generator, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import zenoh
import zstandard
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

import tsd_twin
from bench.bus import client_commands
from bench.programs import Load, dashboard, mock, peer, program, tool
from bench.table import ROUNDS, Row, Run, percentile
from tsd_twin.bus import Bus, client_config
from tsd_twin.recording.channels import RAW
from tsd_twin.recording.recorder import FLUSH_S

_SETTLE_S = 1.5
_KILLS = 3
_BEGUN_BYTES = 5000
_LEG_S = 3.0
"""Duration of each velocity; every fifth is a rest."""
_BEFORE_RESET_S = 1.0
"""A robot refuses to reset within this time after a stop."""


def rows(run: Run) -> Iterator[Row]:
    """Measure while a robot is driven; noise makes its data as hard to compress as real data."""
    if run.wants("recording.cpu", "recording.size", "recording.puts"):
        yield from measure(run, run.pick(3.0, 0.5))
    if run.wants("recording.node", "recording.dashboard", "recording.command"):
        yield from beside(run)
    if run.wants("recording.lost"):
        yield from kill(int(run.pick(_KILLS, 1)))


def measure(run: Run, seconds: float, rounds: int = ROUNDS) -> Iterator[Row]:
    """Compare a recorder with a bare subscriber, and its files with the puts on the bus."""
    with ExitStack() as stack:
        endpoint = stack.enter_context(mock("--noise", "1"))
        folder = stack.enter_context(tempfile.TemporaryDirectory())
        stack.enter_context(dashboard(endpoint))
        stack.enter_context(_driven(endpoint))
        bare = peer("subscriber", endpoint)
        stack.enter_context(bare)
        with recorder(endpoint, folder) as measured:
            time.sleep(_SETTLE_S)
            puts, before_bytes = _Puts(endpoint), _size(folder)
            yield from run.alternate(
                ["recording.cpu"],
                lambda: [measured.load(seconds)],
                lambda: [bare.load(seconds)],
                rounds=rounds,
            )
            puts.close()
            time.sleep(_SETTLE_S)  # The recorder may receive a put later than the subscriber.
            size = _size(folder) - before_bytes
        counted, missing, where = puts.total, *puts.missing_in(Path(folder))
    yield Row("recording.size", [1e-6 * size], [1e-6 * puts.compressed])
    yield Row("recording.puts", [counted - missing], [counted], note=f"{missing} missing{where}")


@contextlib.contextmanager
def recorder(endpoint: str, folder: str) -> Generator[program]:
    """Run a recorder."""
    measured = tool("tsd_record", "--connect", endpoint, "--dir", folder)
    with measured:
        yield measured


def beside(run: Run) -> Iterator[Row]:
    """Measure node, dashboard and commands in turn with and without a recorder."""
    count, seconds = int(run.pick(40, 10)), run.pick(1.5, 0.5)
    node = mock("--noise", "1")
    with ExitStack() as stack:
        endpoint = stack.enter_context(node)
        folder = stack.enter_context(tempfile.TemporaryDirectory())
        page = dashboard(endpoint)
        stack.enter_context(page)
        bus = stack.enter_context(Bus(client_config([endpoint])))

        def alone() -> tuple[float, float, float]:
            time.sleep(0.5)
            with _driven(endpoint), Load(node) as of_node, Load(page) as of_page:
                time.sleep(seconds)
            delay_ms = percentile(client_commands(bus, tsd_twin.connect(endpoint), count), 0.5)
            return of_node.ms_per_s, of_page.ms_per_s, delay_ms

        def with_one() -> tuple[float, float, float]:
            with recorder(endpoint, folder):
                return alone()

        names = ["recording.node", "recording.dashboard", "recording.command"]
        yield from run.alternate(names, with_one, alone, rounds=3)


def kill(count: int) -> Iterator[Row]:
    """Kill recorders at random moments, and measure the loss with third-party readers."""
    chance, killed_ns = np.random.default_rng(1), dict[Path, int]()
    with (
        mock("--noise", "1") as endpoint,
        tempfile.TemporaryDirectory() as folder,
        _driven(endpoint),
    ):
        for _ in range(count):
            measured = tool("tsd_record", "--connect", endpoint, "--dir", folder)
            with measured as path:
                while Path(path).stat().st_size < _BEGUN_BYTES:
                    time.sleep(0.05)
                time.sleep(chance.uniform(0.0, 1.0))
                killed_ns[Path(path)] = time.time_ns()
                measured.process.kill()
        with recorder(endpoint, folder):
            pass  # The recorder repairs the files.
        lost_s = [1e-9 * (at_ns - _last_state_ns(path)) for path, at_ns in killed_ns.items()]
    note = f"{count} kills, median {np.median(lost_s):.2f} s; read by mcap and rosbags"
    yield Row("recording.lost", [max(lost_s)], [FLUSH_S], note=note)


def _last_state_ns(path: Path) -> int:
    """Return the time of the last state in a file, according to two third-party readers."""
    with path.open("rb") as file:
        times_ns = [
            message.log_time
            for _, channel, message in make_reader(file, validate_crcs=True).iter_messages()
            if "/state/" in channel.topic
        ]
    with AnyReader([path]) as reader:
        states = [each for each in reader.connections if "/state/odom" in each.topic]
        odometry = [reader.deserialize(raw, c.msgtype) for c, _, raw in reader.messages(states)]
    if not odometry:
        raise RuntimeError(f"{path} has no odometry")
    return max(times_ns)


def _size(folder: str) -> int:
    return sum(path.stat().st_size for path in Path(folder).iterdir())


class _Puts:
    """All puts on a bus, counted by a subscriber that shares no code with the recorder."""

    def __init__(self, endpoint: str) -> None:
        config: Any = zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", f'["{endpoint}"]')
        config.insert_json5("scouting/multicast/enabled", "false")
        self.compressed = 0
        """Size of all payloads as one compressed stream per second, bytes: a lower bound."""
        self._pending: list[bytes] = []
        self._pending_s = time.monotonic()
        self._seen: Counter[tuple[str, int]] = Counter()
        self._at_s: dict[tuple[str, int], float] = {}
        self._start_s = time.monotonic()
        self._session: Any = zenoh.open(config)
        self._subscriber: Any = self._session.declare_subscriber("twin/**", self._note)

    @property
    def total(self) -> int:
        """Number of puts."""
        return self._seen.total()

    def close(self) -> None:
        """End."""
        self._subscriber.undeclare()
        self._session.close()

    def missing_in(self, folder: Path) -> tuple[int, str]:
        """Return the number of puts missing in a folder's files, by key and payload, and their
        times.
        """
        missing = self._seen.copy()
        for path in folder.glob("*.mcap"):
            with path.open("rb") as file:
                for _schema, channel, message in make_reader(file).iter_messages(
                    log_time_order=False
                ):
                    key, payload = channel.topic, message.data
                    if key.endswith(RAW):
                        encoded = msgspec.json.decode(payload).get("payload")
                        if encoded is None:
                            continue
                        key, payload = key.removesuffix(RAW), base64.b64decode(encoded)
                    missing[key, hash(payload)] -= 1
        lost = [put for put, count in missing.items() if count > 0]
        if not lost:
            return 0, ""
        at_s = sorted(self._at_s[put] for put in lost)
        where = (
            f", put from {at_s[0]:.2f} to {at_s[-1]:.2f} s, on {len({key for key, _ in lost})} keys"
        )
        return sum(missing[put] for put in lost), where

    def _note(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.PUT:
            put = str(sample.key_expr), hash(sample.payload.to_bytes())
            self._seen[put] += 1
            self._pending.append(sample.payload.to_bytes())
            if time.monotonic() - self._pending_s > FLUSH_S:
                self.compressed += len(zstandard.compress(b"".join(self._pending)))
                self._pending, self._pending_s = [], time.monotonic()
            self._at_s[put] = time.monotonic() - self._start_s


class _driven:  # noqa: N801  It is used as a function.
    """Robot driven with a random velocity every few seconds and rests in between."""

    def __init__(self, endpoint: str) -> None:
        self._endpoint = endpoint
        self._stop, self._drives = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._drive)

    def __enter__(self) -> _driven:
        self._thread.start()
        if not self._drives.wait(30.0):
            raise RuntimeError("the robot does not drive")
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    def _drive(self) -> None:
        random = np.random.default_rng(1)
        with tsd_twin.connect(self._endpoint) as robot:
            while not self._stop.is_set():
                with (
                    contextlib.suppress(tsd_twin.TwinError),  # It stopped automatically.
                    robot.control("bench", arm=False) as base,
                ):
                    if robot.state.mode in ("stopped", "fault"):
                        base.reset()
                    base.arm()
                    self._drives.set()
                    self._legs(robot, base, random)
                if not self._stop.is_set():
                    robot.sleep(_BEFORE_RESET_S)

    def _legs(
        self,
        robot: tsd_twin.RobotClient,
        base: tsd_twin.RobotControl,
        random: np.random.Generator,
    ) -> None:
        for leg in range(1_000_000):
            vx_mps, omega_rad_per_s = random.uniform(-1.0, 1.0, size=2) * (leg % 5 > 0)
            end_s = time.monotonic() + _LEG_S
            while time.monotonic() < end_s:
                if self._stop.is_set():
                    return
                base.set_velocity(
                    vx_mps=0.5 * float(vx_mps), omega_rad_per_s=float(omega_rad_per_s)
                )
                robot.sleep(0.05)


def main() -> None:
    """Measure for the given time."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=3600.0)
    parser.add_argument("--kills", type=int, default=0)
    args = parser.parse_args()
    rows = kill(args.kills) if args.kills else measure(Run(), args.seconds, rounds=1)
    for row in rows:
        print(row, flush=True)


if __name__ == "__main__":
    main()
