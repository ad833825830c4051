"""`tsd-demo`: simulated robots and their dashboard, with one command."""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import random
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.request
import webbrowser
from collections.abc import Generator
from pathlib import Path
from typing import IO

from tsd_twin import robots
from tsd_twin.bus import over_datagrams
from tsd_twin.cli import flags, program, robot_flags
from tsd_twin.errors import TwinError, check_extra
from tsd_twin.lie import SE2
from tsd_twin.link_emulation import LinkSpec
from tsd_twin.messages import topics

with program.requires("tsd-demo", "dashboard"):
    from tsd_twin.recording.folder import default_folder


ANY_PORTS = range(20_000, 30_000)
"""Search range for free ports, below the ephemeral ports that operating systems assign."""
START_TIMEOUT_S = 30.0
"""Timeout for a program to become ready."""
BUS_PORT = 7447
PAGE_PORT = 8080
ALONE = ("--listen", "tcp/127.0.0.1:0")
"""Bus flags of robots that are reached through the first one."""
SPACING_M = 1.0
"""Distance between robots that start side by side."""

PARSER = program.parser(
    "tsd-demo",
    "Simulated robots and their dashboard in the browser. Ctrl-C ends all.",
    [
        "tsd-demo                        drive the triple singularity drive",
        "tsd-demo --robot atlas          turn a sphere; also omni4, kiwi, mecanum",
        "tsd-demo --robot my.toml        drive a robot of your own",
        "tsd-demo --robot tsd --robot omni4 --robot atlas    several in one page",
        "tsd-demo --link delay=150ms     drive it over a bad link, see tsd-link --help",
        "tsd-demo --plant mujoco         move it as rigid bodies on a floor, not by equations",
        "tsd-demo --noise 1 --camera     see a camera correct what wheels get wrong",
        "tsd-demo --webcam               poses from tags in the pictures of a simulated webcam",
        "tsd-demo --no-browser           print the address and leave the browser alone",
        "tsd-demo --no-record            do not record; --record-dir drives records elsewhere",
    ],
)


def demonstrate(args: argparse.Namespace) -> None:
    """Start all processes, and stop all if one ends or a signal arrives."""
    stop = program.stop_event(args)
    link = LinkSpec.parse(args.link) if args.link else None
    chosen = cast_of(args.robot or ["tsd"], args.id, camera=args.camera)
    # Over TCP, each loss on a bad link would delay everything after it.
    protocol, kind = ("udp", socket.SOCK_DGRAM) if link else ("tcp", socket.SOCK_STREAM)
    bus_port = free_port(args.bus_port, BUS_PORT, kind)
    page_port = free_port(args.port, PAGE_PORT)
    folder = None if args.no_record else record_folder(args.record_dir)
    endpoint = f"{protocol}/127.0.0.1:{bus_port}"
    if args.bus_port is None and bus_port != BUS_PORT:
        where = f"port {BUS_PORT} is in use, so the bus of this demo is at {endpoint}"
        print(f"{where}: name that to other programs", flush=True)
    if args.port is None and page_port != PAGE_PORT:
        print(f"port {PAGE_PORT} is in use, so the page is at port {page_port}", flush=True)
    listening = over_datagrams(endpoint) if link else endpoint
    with contextlib.ExitStack() as running:
        # The first robot routes for the others, so that all share one bus.
        doors = [["--listen", listening], *([*ALONE, "--connect", listening] for _ in chosen[1:])]
        robots_ready = [
            running.enter_context(start_program([*role, *door, *flags_of_robots(args)], stop))
            for role, door in zip(chosen, doors, strict=True)
        ]
        dashboard = ["tsd_dashboard", "--port", str(page_port), *dashboard_flags(args, folder)]
        dashboard += ["--connect", running.enter_context(linked(link, endpoint, stop))]
        for role in chosen:
            dashboard += ["--first", role[role.index("--id") + 1]]
        recorder_ready = folder and running.enter_context(
            recorder(folder, args.keep_gb, listening, stop)
        )
        if args.webcam:
            running.enter_context(start_program(webcam(chosen, listening), stop))
        page_ready = running.enter_context(start_program(dashboard, stop))
        for ready in robots_ready:
            ready.wait_for()
        if recorder_ready:
            recorder_ready.wait_for()
            print(f"recording into {folder}, at most {args.keep_gb:g} GB", flush=True)
        url = page_ready.wait_for().split()[1]
        wait_for_robots(url, len(chosen), stop)
        program.say_ready(f"{url} with the bus at {endpoint}; Ctrl-C ends all")
        if not args.no_browser:
            # A browser may block its console while it runs.
            threading.Thread(target=webbrowser.open, args=(url,), daemon=True).start()
        stop.wait()


def flags_of_robots(args: argparse.Namespace) -> list[str]:
    """Return the flags of every robot."""
    scales = ["--noise", str(args.noise), "--errors", str(args.errors)]
    return [*scales, "--plant", args.plant, *["--verbose"] * args.verbose]


def dashboard_flags(args: argparse.Namespace, folder: Path | None) -> list[str]:
    """Return the flags of the dashboard, except for its ports and robots."""
    recordings = ["--record-dir", str(folder)] if folder else []
    return [*["--verbose"] * args.verbose, *recordings, *program.viewport_flags(args)]


def webcam(chosen: list[list[str]], endpoint: str) -> list[str]:
    """Return the command line of a simulated camera above the floor, with a tag on each robot.

    Raises:
        TwinError: If OpenCV is not installed.
    """
    check_extra("--webcam", "camera")
    ids = [role[role.index("--id") + 1] for role in chosen]
    tags = [text for number, id_ in enumerate(ids) for text in ("--tag", f"{number}={id_}")]
    return ["tsd_camera", "--simulate", "--connect", endpoint, *tags]


def cast_of(names: list[str], robot_id: str | None, *, camera: bool = False) -> list[list[str]]:
    """Return the command line of each robot, with its bus id and start pose.

    With `camera`, planar robots have an overhead camera.
    """
    if robot_id and len(names) > 1:
        raise TwinError("--id is for one robot; several are called by their names")
    if robot_id:
        topics.checked(robot_id)
    # Report invalid files before any process starts.
    described = [robots.load_robot(name) for name in names]
    moving = [robot.kinematics().pose_type is SE2 for robot in described]
    spots = iter(range(0 if all(moving) else 1, len(moving) + 1))
    places = [spot(next(spots)) if moves else "" for moves in moving]  # Spheres have none.
    ids: list[str] = []
    for robot in described:
        number = sum(robot.name == other.name for other in described[: len(ids)]) + 1
        ids.append(robot_id or (robot.name if number == 1 else f"{robot.name[:29]}-{number}"))
    return [
        [
            *("tsd_mock", "--robot", name, "--id", id_),
            *(["--at", place] if place else []),
            *(["--camera"] if camera and drives else []),
        ]
        for name, id_, place, drives in zip(names, ids, places, moving, strict=True)
    ]


def spot(number: int) -> str:
    """Return a place on a line across the driving direction: middle, left, right, and outwards."""
    side = (number + 1) // 2 * (1 if number % 2 else -1)
    return f"0,{SPACING_M * side:g},0" if number else ""


def record_folder(chosen: Path | None) -> Path | None:
    """Return the folder for recordings, or None if the default one is not writable."""
    folder = chosen or default_folder()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        writable = os.access(folder, os.W_OK | os.X_OK)
    except OSError:
        writable = False
    if writable:
        return folder
    if chosen is not None:
        raise TwinError(f"--record-dir: {chosen} cannot be written to")
    print(f"not recording: {folder} cannot be written to", file=sys.stderr)
    return None


@contextlib.contextmanager
def recorder(
    folder: Path, keep_gb: float, endpoint: str, stop: threading.Event
) -> Generator[Subprocess]:
    """Run a recorder in addition to the robots; they keep running if it ends."""
    command = ["tsd_record", "--dir", str(folder), "--keep-gb", str(keep_gb), "--connect", endpoint]
    ended = threading.Event()

    def watch() -> None:
        ended.wait()
        if not stop.is_set():
            print("the recorder has ended: nothing is recorded any more", file=sys.stderr)

    with start_program(command, ended) as ready:
        threading.Thread(target=watch, daemon=True).start()
        yield ready


@contextlib.contextmanager
def linked(link: LinkSpec | None, endpoint: str, stop: threading.Event) -> Generator[str]:
    """Yield the dashboard's endpoint of the robot, behind an emulated link if requested."""
    if link is None:
        yield endpoint
        return
    with start_program(["tsd_link", "--target", endpoint, "--link", str(link)], stop) as ready:
        yield over_datagrams(ready.wait_for().split()[-1])


def wait_for_robots(url: str, count: int, stop: threading.Event) -> None:
    """Wait until the dashboard shows all robots."""
    end_s = time.monotonic() + START_TIMEOUT_S
    while not stop.wait(0.05):
        with urllib.request.urlopen(f"{url}healthz") as answer:  # noqa: S310  Our own page.
            health = json.load(answer)
            if health["ready"] and len(health["robots"]) >= count:
                return
        if time.monotonic() > end_s:
            raise TwinError(f"the dashboard did not see every robot within {START_TIMEOUT_S:g} s")


class Subprocess:
    """Running child process; forwards its output and stores its `ready:` line."""

    def __init__(self, name: str, process: subprocess.Popen[str], stop: threading.Event) -> None:
        self._name = name
        self._process = process
        self._stop = stop
        self._ready = threading.Event()
        self._line = ""
        assert process.stdout is not None  # noqa: S101  Opened as a pipe by `start_program`.
        threading.Thread(target=self._read, args=(process.stdout,), daemon=True).start()

    def wait_for(self) -> str:
        """Wait for the program's `ready:` line and return it."""
        if not self._ready.wait(START_TIMEOUT_S):
            raise TwinError(f"{self._name} was not ready within {START_TIMEOUT_S:g} s")
        if not self._line:
            if self._process.wait(START_TIMEOUT_S) == 0:
                sys.exit(0)  # Ended by a signal while starting, such as Ctrl-C.
            raise TwinError(f"{self._name} ended before it was ready; see above")
        return self._line

    def _read(self, output: IO[str]) -> None:
        for line in output:
            if line.startswith("ready: "):
                self._line = line.strip()
                self._ready.set()
        self._ready.set()
        self._stop.set()  # The parent ends if one of its programs ends.


@contextlib.contextmanager
def start_program(arguments: list[str], stop: threading.Event) -> Generator[Subprocess]:
    """Run one of the project's programs, and end it on exit."""
    # In a separate process group: Ctrl-C reaches only the parent, which ends the children in order.
    # If the parent is killed, the broken pipe ends them.
    process = subprocess.Popen(  # noqa: S603  Own program with parsed flags.
        [sys.executable, "-P", "-m", *arguments, "--until-eof"],
        stdout=subprocess.PIPE,
        stdin=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        yield Subprocess(arguments[0].replace("_", "-"), process, stop)
    finally:
        process.send_signal(signal.SIGTERM)
        try:
            process.wait(5.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def free_port(chosen: int | None, usual: int, kind: socket.SocketKind = socket.SOCK_STREAM) -> int:
    """Return the chosen port if it is free; by default the usual port, or any free one."""
    anywhere = random.sample(ANY_PORTS, 32)
    for port in anywhere if chosen == 0 else (chosen,) if chosen else (usual, *anywhere):
        with socket.socket(type=kind) as probe:
            if kind is socket.SOCK_STREAM:
                # As servers do, so that a recently used port counts as free.
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind(("127.0.0.1", port))
            except (OSError, OverflowError):
                continue
            return port
    raise TwinError(f"port {chosen} cannot be used: choose another, or 0 for any free one")


def main() -> None:
    """Parse the flags and run."""
    robot_flags.add_robot_flags(PARSER, several=True)
    flags.add(PARSER, "--port", f"of the page; default {PAGE_PORT}, or any free one", flags.PORT)
    program.add_viewport_flags(PARSER)
    flags.add(PARSER, "--bus-port", f"of the bus; default {BUS_PORT}, or any free one", flags.PORT)
    flags.add(PARSER, "--noise", "times [noise]", flags.SCALE, 0.0)
    robot_flags.add_errors_flag(PARSER)
    text = "a camera above the floor tells robots where they are: 24 frames/s, 80 ms late"
    PARSER.add_argument("--camera", action="store_true", help=text)
    text = "a simulated webcam above the floor publishes pictures, and poses from printed tags"
    PARSER.add_argument("--webcam", action="store_true", help=f"{text}; needs the extra `camera`")
    robot_flags.add_plant_flag(PARSER)
    PARSER.add_argument("--link", metavar="SPEC", help="put a bad link between them")
    program.add_recordings_flags(PARSER, "--record-dir")
    PARSER.add_argument("--no-record", action="store_true", help="do not record")
    PARSER.add_argument("--no-browser", action="store_true", help="do not open a browser")
    program.run(PARSER, demonstrate)


if __name__ == "__main__":
    main()
