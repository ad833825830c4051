"""CPU load and disk usage of a recorder, and completeness of its files.

`python -m bench.recording --seconds 3600` takes an hour; `--kills 20` kills a recorder 20 times.
"""

from __future__ import annotations

import argparse
import base64
import contextlib
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import zenoh
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

import tsd_twin
from bench.bus import client_commands, program
from bench.idle import share_of_a_core, shares_of_a_core
from bench.table import Row, percentile
from tsd_twin.bus import Bus, client_config
from tsd_twin.recording.channels import RAW

_SETTLE_S = 3.0
_SECONDS = 20.0
_SMALLEST_S = 0.5
_KILLS = 5
_COMMANDS = 300
_TURNS = 3
_FEW_COMMANDS = 20
_BEGUN_BYTES = 5000
_LEG_S = 3.0
"""Duration of each velocity; every fifth is a rest."""
_BEFORE_RESET_S = 1.0
"""A robot refuses to reset a stop that has just begun."""

_FLOOR = """
import sys
from tsd_twin.bus import Bus, client_config, clients_of
with Bus(clients_of(client_config([sys.argv[1]]), 3.0)[0]) as bus:
    bus.subscribe("twin/**", lambda sample: None)
    print("ready:", sys.argv[1], flush=True)
    sys.stdin.read()
"""


def rows(*, smallest: bool = False) -> Iterator[Row]:
    """Measure while a robot is driven; noise makes its data as hard to compress as real data.

    The bare subscriber and the recorder listen to the same robot, one after the other.
    """
    settle_s, seconds = (_SMALLEST_S, _SMALLEST_S) if smallest else (_SETTLE_S, _SECONDS)
    yield from measure(settle_s, seconds, seconds)
    yield from beside(settle_s, seconds, smallest=smallest)
    yield from kill(1 if smallest else _KILLS)


def measure(settle_s: float, floor_s: float, seconds: float) -> Iterator[Row]:
    """Measure a bare subscriber, then a recorder for `seconds`, each together with a dashboard."""
    mock = program([*_run("tsd_mock"), "--listen", "tcp/127.0.0.1:0", "--noise", "1"])
    with (
        mock as endpoint,
        tempfile.TemporaryDirectory() as folder,
        program([*_run("tsd_dashboard"), "--port", "0", "--connect", endpoint]),
        _driven(endpoint) as driven,
    ):
        bare = program([sys.executable, "-c", _FLOOR, endpoint])
        with bare:
            floor = share_of_a_core(bare.process.pid, settle_s, floor_s)
        recorder = program([*_run("tsd_record"), "--connect", endpoint, "--dir", folder])
        with recorder:
            time.sleep(settle_s)
            puts = _Puts(endpoint)
            before, start_s = _size_mb(folder), time.monotonic()
            load = share_of_a_core(recorder.process.pid, 0.0, seconds)
            minutes = (time.monotonic() - start_s) / 60.0
            grown_mb = _size_mb(folder) - before
            puts.close()
            time.sleep(settle_s)  # The recorder may receive a put later than the subscriber.
        counted, missing, where = puts.total, *puts.missing_in(Path(folder))
    yield Row("recorder of one robot, of one core", load, 6.0, "%", f"subscriber {floor:.1f} %")
    about = f"{grown_mb:.1f} MB in {minutes:.1f} min, {driven.stops} stops"
    yield Row("recording of one robot that drives", grown_mb / minutes, 2.5, "MB/min", about)
    recorded = 100.0 * (1.0 - missing / max(counted, 1))
    about = f"{missing} of {counted} counted by bare Zenoh are missing{where}"
    yield Row("puts of the bus that are on record", recorded, 100.0, "%", about, at_least=True)


def beside(settle_s: float, seconds: float, *, smallest: bool = False) -> Iterator[Row]:
    """Measure node, dashboard and commands, alternating without and with a recorder."""
    count, turns = (_FEW_COMMANDS, 1) if smallest else (_COMMANDS, _TURNS)
    mock = program([*_run("tsd_mock"), "--listen", "tcp/127.0.0.1:0", "--noise", "1"])
    with mock as endpoint, tempfile.TemporaryDirectory() as folder:
        dashboard = program([*_run("tsd_dashboard"), "--port", "0", "--connect", endpoint])
        with dashboard:
            pids = mock.process.pid, dashboard.process.pid

            def once() -> list[float]:
                with _driven(endpoint):
                    loads = shares_of_a_core(pids, settle_s, seconds)
                with Bus(client_config([endpoint])) as bus:
                    return [*loads, percentile(client_commands(bus, endpoint, count), 0.5)]

            without, during = [once()], list[list[float]]()
            for _ in range(turns):  # Start and end without a recorder, because a machine warms up.
                with program([*_run("tsd_record"), "--connect", endpoint, "--dir", folder]):
                    during.append(once())
                without.append(once())
    names = "node", "dashboard"
    for name, beside_one, alone in zip(names, _columns(during), _columns(without), strict=False):
        about = f"medians; without one {_spread(alone, 1)} %, beside one {_spread(beside_one, 1)} %"
        limit = max(1.1 * float(np.median(alone)), max(alone))
        yield Row(f"{name} beside a recorder", float(np.median(beside_one)), limit, "%", about)
    delays_ms, alone_ms = _columns(during)[2], _columns(without)[2]
    about = f"without one {_spread(alone_ms, 2)} ms, beside one {_spread(delays_ms, 2)} ms"
    limit_ms = max(alone_ms) + 1.0
    name = "set_velocity to set-point beside a recorder, p50"
    yield Row(name, float(np.median(delays_ms)), limit_ms, "ms", about)


def _columns(turns: list[list[float]]) -> list[list[float]]:
    return [list(column) for column in zip(*turns, strict=True)]


def _spread(values: list[float], digits: int) -> str:
    return f"{np.median(values):.{digits}f} ({min(values):.{digits}f} to {max(values):.{digits}f})"


def kill(count: int) -> Iterator[Row]:
    """Kill recorders at random moments, and measure the loss with third-party readers."""
    mock = program([*_run("tsd_mock"), "--listen", "tcp/127.0.0.1:0", "--noise", "1"])
    chance, killed_ns = np.random.default_rng(1), dict[Path, int]()
    with mock as endpoint, tempfile.TemporaryDirectory() as folder, _driven(endpoint):
        record = [*_run("tsd_record"), "--connect", endpoint, "--dir", folder]
        for _ in range(count):
            recorder = program(record)
            with recorder as path:
                while Path(path).stat().st_size < _BEGUN_BYTES:
                    time.sleep(0.05)
                time.sleep(chance.uniform(0.0, 1.0))
                killed_ns[Path(path)] = time.time_ns()
                recorder.process.kill()
        with program(record):
            pass  # The recorder repairs the files.
        lost_s = [1e-9 * (at_ns - _last_state_ns(path)) for path, at_ns in killed_ns.items()]
    about = f"{count} kills, median {np.median(lost_s):.2f} s; read by mcap and rosbags"
    yield Row("lost by kill -9 of a recorder, worst", max(lost_s), 1.0, "s", about)


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


def _run(name: str) -> list[str]:
    return [sys.executable, "-m", name, "--until-eof"]


def _size_mb(folder: str) -> float:
    return sum(path.stat().st_size for path in Path(folder).iterdir()) / 1e6


class _Puts:
    """All puts on a bus, counted by a subscriber that shares no code with the recorder."""

    def __init__(self, endpoint: str) -> None:
        config: Any = zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", f'["{endpoint}"]')
        config.insert_json5("scouting/multicast/enabled", "false")
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
            self._at_s[put] = time.monotonic() - self._start_s


class _driven:  # noqa: N801  It is used as a function.
    """Robot driven with a random velocity every few seconds and rests in between."""

    def __init__(self, endpoint: str) -> None:
        self._endpoint = endpoint
        self._stop, self._drives = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._drive)
        self.stops = 0
        """Number of automatic stops, which occur on a busy machine."""

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
                    self.stops += 1
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
    for row in kill(args.kills) if args.kills else measure(_SETTLE_S, _SECONDS, args.seconds):
        print(row, flush=True)


if __name__ == "__main__":
    main()
