"""Adapters compared with bare forwarders: delay of a twist to the setpoint, and CPU load."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack

from bench import peers
from bench.bus import paced_speeds, watch_setpoint
from bench.programs import Load, mock, peer, program
from bench.table import Row, Run, quantiles
from tsd_twin.bus import Bus, client_config

Send = Callable[[float], None]
Buses = tuple[Bus, Bus]


def robots(stack: ExitStack) -> tuple[str, str, Buses]:
    """Start a simulated robot and a bare loop; return their endpoints and sessions."""
    endpoints = [stack.enter_context(each) for each in (mock(), peer("node"))]
    buses = [stack.enter_context(Bus(client_config([each]))) for each in endpoints]
    return endpoints[0], endpoints[1], (buses[0], buses[1])


def adapter_rows(
    run: Run, name: str, buses: Buses, subject: tuple[program, Send], bare: tuple[program, Send]
) -> Iterator[Row]:
    """Measure programs with the functions that publish a `cmd_vel` to them.

    `buses`: the simulated robot's and the bare loop's that they drive.
    """
    count = int(run.pick(40, 10))
    ours, theirs = watch_setpoint(buses[0]), threading.Event()
    buses[1].subscribe(peers.SETPOINT, lambda _sample: theirs.set())

    def measure(measured: program, send: Send, came: threading.Event) -> tuple[float, ...]:
        with Load(measured) as load:
            times_ms = paced_speeds(send, came, count)
        return *quantiles(times_ms), load.ms_per_s

    yield from run.alternate(
        [f"{name}.delay_p50", f"{name}.delay_p90", f"{name}.cpu"],
        lambda: measure(*subject, ours),
        lambda: measure(*bare, theirs),
    )
