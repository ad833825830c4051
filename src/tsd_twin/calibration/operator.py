"""Control of the calibrated robot and the terminal: connection, questions, keys."""

from __future__ import annotations

import argparse
import contextlib
import math
import os
import select
import signal
import sys
import termios
import tty
from collections.abc import Callable, Generator

import numpy as np

from tsd_twin.bus import DEFAULT_ENDPOINT, Bus, as_client, client_config, from_file
from tsd_twin.cli import flags
from tsd_twin.client import RobotClient, RobotControl
from tsd_twin.client.bus_port import BusLink
from tsd_twin.client.discovery import robots_on
from tsd_twin.errors import TwinError
from tsd_twin.lie import Array
from tsd_twin.robots.description import Limits


def ask_displacement() -> tuple[Array, float]:
    """Ask for the displacement (2,), metres in the start frame, and the rotation in radians."""
    print_line("How far has it gone, in the directions it had at the start?")
    forward = _ask_number("forward, mm (backward: minus): ")
    left = _ask_number("to its left, mm (right: minus): ")
    turned = _ask_number("turned to the left, degrees (right: minus; count whole turns): ")
    return 0.001 * np.array([forward, left]), math.radians(turned)


def _ask_number(question: str) -> float:
    while True:
        try:
            value = float(ask_line(question))
        except ValueError:
            value = math.nan
        if math.isfinite(value):
            return value
        print_line("a number, please, such as -12.5")


def ask_line(question: str) -> str:
    """Prompt, and return the typed line.

    Raises:
        TwinError: If the input has ended.
    """
    try:
        return input(question)
    except EOFError:
        raise TwinError("no input: the procedure needs an operator at the keyboard") from None


def confirm(args: argparse.Namespace, warning: str) -> None:
    """Print a warning, and wait for the operator's confirmation, unless `--yes` is given."""
    if not args.yes:
        print_line(warning)
        ask_line("Enter begins: ")


@contextlib.contextmanager
def watch_keys() -> Generator[Callable[[], bool]]:
    """Yield a function that tells whether a key was pressed, without Enter.

    It is always false if the input is not a terminal; a closed terminal counts as a key. Ctrl-C
    keeps its meaning. The terminal settings are restored on exit.
    """
    if not (sys.stdin and sys.stdin.isatty()):
        yield lambda: False
        return
    terminal = sys.stdin.fileno()

    def pressed() -> bool:
        ready, _, _ = select.select([terminal], [], [], 0.0)
        if ready:
            os.read(terminal, 64)
        return bool(ready)

    before = termios.tcgetattr(terminal)
    try:
        tty.setcbreak(terminal)
        termios.tcflush(terminal, termios.TCIFLUSH)  # Discard keys typed before.
        yield pressed
    finally:
        termios.tcsetattr(terminal, termios.TCSAFLUSH, before)


def print_line(text: str) -> None:
    """Print a line."""
    print(text)  # noqa: T201  Output for the operator.


_CONNECT_TIMEOUT_S = 3.0


@contextlib.contextmanager
def hold_control(
    client: RobotClient, operator: str, max_age_s: float | None = None
) -> Generator[RobotControl]:
    """Hold the lease; on any exit, including SIGTERM, command zero, disarm and release.

    If this process dies instead, the lease expires and the robot spins down automatically.

    Raises:
        ControlDenied: If another operator has control.
    """
    # SIGTERM raises KeyboardInterrupt like Ctrl-C, so that this context exits.
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    control = client.control(operator, max_age_s=max_age_s, arm=False)
    try:
        control.acquire()
        yield control
    finally:
        # A second interrupt must not leave the wheels spinning.
        previous_sigint = signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        try:
            control.release()
        finally:
            signal.signal(signal.SIGINT, previous_sigint)
            signal.signal(signal.SIGTERM, before)


def interruptible(
    step: Callable[[float], Array | None], key_pressed: Callable[[], bool], pause_s: float
) -> Callable[[float], Array | None]:
    """Wrap `step` so that a key press or a long pause ends the drive.

    Raises:
        TwinError: By the wrapped function, if a key was pressed or the pause exceeds `pause_s`.
    """
    last_s = math.inf

    def guarded(now_s: float) -> Array | None:
        nonlocal last_s
        # After a longer pause the robot has begun to stop, and must not be restarted.
        if now_s - last_s > pause_s:
            raise TwinError(f"this program was held up for {now_s - last_s:.1f} s")
        last_s = now_s
        if key_pressed():
            raise TwinError("stopped by a key")
        return step(now_s)

    return guarded


def longest_pause_s(limits: Limits, max_age_s: float | None) -> float:
    """Return the maximum pause between two commands, under a lease with `max_age_s`."""
    return limits.command_timeout_s + max(0.0, (max_age_s or 0.0) - limits.max_command_age_s)


def add_bus_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of the robot, the bus, the operator and the confirmation."""
    parser.add_argument("--id", help="of the robot on the bus; default: the only one")
    text = f"where a robot listens, may be repeated; default {DEFAULT_ENDPOINT}"
    flags.add(parser, "--connect", text, metavar="ENDPOINT", repeated=True)
    parser.add_argument("--zenoh-config", metavar="FILE", help="a JSON5 file, for TLS and access")
    parser.add_argument("--operator", default="lab", help="who takes control; default lab")
    parser.add_argument("--yes", action="store_true", help="begin at once")


@contextlib.contextmanager
def connect(args: argparse.Namespace) -> Generator[tuple[RobotClient, BusLink]]:
    """Open the bus selected by the flags, and find the robot, without acquiring the lease.

    Raises:
        TwinError: If nothing answers, no robot is found, or the choice is ambiguous.
    """
    config = (
        from_file(args.zenoh_config)
        if args.zenoh_config
        else client_config(args.connect or [DEFAULT_ENDPOINT])
    )
    # A camera connects to the same robot, and is not a peer of this session.
    with Bus(as_client(config, _CONNECT_TIMEOUT_S)) as bus:
        link = BusLink(bus, args.id or _only_robot(bus))
        with RobotClient(link, args.operator) as client:
            yield client, link


def _only_robot(bus: Bus) -> str:
    found = robots_on(bus)
    if len(found) != 1:
        raise TwinError(
            f"choose one with --id: {', '.join(found)} are on the bus"
            if found
            else "no robot is on the bus: start tsd-bridge or tsd-mock, or say --connect"
        )
    return found[0]
