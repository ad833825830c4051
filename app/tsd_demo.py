"""`tsd-demo`: a simulated robot and its dashboard, with one command."""

from __future__ import annotations

import argparse
import contextlib
import json
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.request
import webbrowser
from collections.abc import Generator
from typing import IO

from tsd_twin import program
from tsd_twin.errors import TwinError
from tsd_twin.linksim import LinkSpec

BUS_PORT = 7447
PAGE_PORT = 8080
_PATIENCE_S = 30.0

PARSER = program.parser(
    "tsd-demo",
    "A simulated robot and its dashboard in the browser. Ctrl-C ends both.",
    [
        "tsd-demo                        drive the triple singularity drive",
        "tsd-demo --robot my.toml        drive a robot of your own",
        "tsd-demo --link delay=150ms     drive it over a bad link, see tsd-link --help",
        "tsd-demo --no-browser           print the address and leave the browser alone",
    ],
)


def demonstrate(args: argparse.Namespace) -> None:
    """Start both processes, and end both when one ends or a signal comes."""
    stop = program.stop_event(args)
    link = LinkSpec.parse(args.link) if args.link else None
    bus_port = free_port(args.bus_port, BUS_PORT)
    page_port = free_port(args.port, PAGE_PORT)
    endpoint = f"tcp/127.0.0.1:{bus_port}"
    robot = ["--robot", args.robot, *(["--id", args.id] if args.id else [])]
    noise = ["--noise", str(args.noise)]
    verbose = ["--verbose"] if args.verbose else []
    mock = ["tsd_mock", *robot, *noise, "--listen", endpoint, *verbose]
    dashboard = ["tsd_dashboard", "--port", str(page_port), *verbose, "--connect"]
    with (
        child(mock, stop) as robot_ready,
        linked(link, endpoint, stop) as robot_seen_at,
        child([*dashboard, robot_seen_at], stop) as page_ready,
    ):
        robot_ready.wait_for()
        url = page_ready.wait_for().split()[1]
        wait_for_robot(url, stop)
        program.say_ready(f"{url} with the bus at {endpoint}; Ctrl-C ends both")
        if not args.no_browser:
            # A browser may hold its own console for as long as it runs.
            threading.Thread(target=webbrowser.open, args=(url,), daemon=True).start()
        stop.wait()


class Child:
    """A started program, its output passed on, its `ready:` line kept."""

    def __init__(self, name: str, process: subprocess.Popen[str], stop: threading.Event) -> None:
        self._name = name
        self._process = process
        self._stop = stop
        self._ready = threading.Event()
        self._line = ""
        assert process.stdout is not None  # noqa: S101  It was asked for; this tells the type checker.
        threading.Thread(target=self._read, args=(process.stdout,), daemon=True).start()

    def wait_for(self) -> str:
        """Return the line that says it is ready.

        Raises:
            TwinError: it ended, or took too long.
        """
        if not self._ready.wait(_PATIENCE_S):
            raise TwinError(f"{self._name} was not ready within {_PATIENCE_S:g} s")
        if not self._line:
            if self._process.wait(_PATIENCE_S) == 0:
                sys.exit(0)  # It was told to end while starting, as by Ctrl-C.
            raise TwinError(f"{self._name} ended before it was ready; see above")
        return self._line

    def _read(self, output: IO[str]) -> None:
        for line in output:
            if line.startswith("ready: "):
                self._line = line.strip()
                self._ready.set()
        self._ready.set()
        self._stop.set()  # One without the other is of no use.


@contextlib.contextmanager
def child(arguments: list[str], stop: threading.Event) -> Generator[Child]:
    """Run one of our programs for as long as this context lasts."""
    # Its own process group: Ctrl-C comes to us only, and we end the two in order. When we are
    # killed, nothing can be ended in order: the pipe that breaks then ends them.
    process = subprocess.Popen(  # noqa: S603  The program is ours, the flags went through argparse.
        [sys.executable, "-m", *arguments, "--until-eof"],
        stdout=subprocess.PIPE,
        stdin=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        yield Child(arguments[0].replace("_", "-"), process, stop)
    finally:
        process.send_signal(signal.SIGTERM)
        try:
            process.wait(5.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


@contextlib.contextmanager
def linked(link: LinkSpec | None, endpoint: str, stop: threading.Event) -> Generator[str]:
    """Yield where the dashboard finds the robot: behind a bad link, when one is asked for."""
    if link is None:
        yield endpoint
        return
    with child(["tsd_link", "--target", endpoint, "--link", str(link)], stop) as ready:
        yield ready.wait_for().split()[-1]


def wait_for_robot(url: str, stop: threading.Event) -> None:
    """Wait until the dashboard sees the robot, since a page without one is no demo.

    Raises:
        TwinError: it took too long.
    """
    end_s = time.monotonic() + _PATIENCE_S
    while not stop.wait(0.05):
        with urllib.request.urlopen(f"{url}healthz") as answer:  # noqa: S310  Our own page.
            if json.load(answer)["ready"]:
                return
        if time.monotonic() > end_s:
            raise TwinError(f"the dashboard did not see the robot within {_PATIENCE_S:g} s")


def free_port(chosen: int | None, usual: int) -> int:
    """Return the chosen port if it is free; when none was chosen the usual one, or any free one.

    Raises:
        TwinError: the chosen port is in use, or is none.
    """
    for port in (usual, 0) if chosen is None else (chosen,):
        with socket.socket() as probe:
            # As servers do, so that a port that was in use a minute ago counts as free.
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind(("127.0.0.1", port))
            except (OSError, OverflowError):
                continue
            return probe.getsockname()[1]
    raise TwinError(f"port {chosen} cannot be used: choose another, or 0 for any free one")


def main() -> None:
    """Read the flags and run."""
    program.add_robot_flags(PARSER)
    PARSER.add_argument(
        "--port", type=int, help=f"of the page; default {PAGE_PORT}, or any free one"
    )
    PARSER.add_argument(
        "--bus-port", type=int, help=f"of the bus; default {BUS_PORT}, or any free one"
    )
    PARSER.add_argument("--noise", type=float, default=0.0, help="times [noise]; default 0")
    PARSER.add_argument("--link", metavar="SPEC", help="put a bad link between the two")
    PARSER.add_argument("--no-browser", action="store_true", help="do not open a browser")
    program.run(PARSER, demonstrate)


if __name__ == "__main__":
    main()
