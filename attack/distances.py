"""Stopping distances of each shipped robot from full speed after a fault, and the guaranteed ones.

`python -m attack.distances --runs 10 --robots tsd,kiwi --causes downlink --leases 0.25`
"""

from __future__ import annotations

import argparse
import contextlib
import multiprocessing
import os
import random
import signal
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

from attack.client_operators import FoxgloveOperator, ScriptOperator
from attack.operators import PageBehindGateway, UncheckedOperator
from attack.scenes import Scene, on_a_link, with_board
from attack.table import Row
from tsd_twin import robots
from tsd_twin.errors import TwinError
from tsd_twin.link_emulation.emulator import Direction
from tsd_twin.robots import RobotDescription

MAX_AGES_S = (0.25, 0.5, 1.0)
HASTE = 2.0
"""Commanded speed, as a multiple of the speed limit, so that the robot drives at its limit."""
BEYOND_S = 0.6
"""Faults last for the maximum command age plus this time, by which the robot must be at rest."""
WATCHED_S = 0.4
"""Observation time after the end of the fault."""
REPEATED_S = 0.17
"""Time for which the program repeats the last input before it is stopped too."""
PHASE_S = 0.1
"""Faults start at a random phase between two messages."""


Fault = Callable[[Scene], tuple[float, float]]
"""Causes a fault; returns its start and end, monotonic time."""


ATTEMPTS = 8
"""Attempts to reach full speed before the fault, even on a busy machine."""


@dataclass(frozen=True)
class Cause:
    """Type of fault."""

    name: str
    text: str
    operator: str
    """Kind of operator: `page`, `raw` (unchecked), `script`, `foxglove`, or `node`: unchecked, with
    a board that outlives the node.
    """
    fault: Fault = field(repr=False)


def stalled(*directions: Direction) -> Fault:
    """Return a fault that stalls a link, which then delivers all delayed packets."""

    def fault(scene: Scene) -> tuple[float, float]:
        assert scene.link is not None
        length_s = scene.max_age_s + BEYOND_S
        at_s = time.monotonic()
        scene.link.stall(length_s, directions)
        if isinstance(scene.operator, UncheckedOperator):
            # It sends commands during the stall, and ends before the link delivers again.
            time.sleep(length_s - 0.1)
            scene.operator.release()
        return at_s, at_s + length_s

    return fault


def killed(pid: Callable[[Scene], int]) -> Fault:
    """Return a fault that kills a process."""

    def fault(scene: Scene) -> tuple[float, float]:
        at_s = time.monotonic()
        os.kill(pid(scene), signal.SIGKILL)
        # Until then, an earlier command could still be accepted.
        return at_s, at_s + scene.max_age_s + BEYOND_S

    return fault


def hung(pid: Callable[[Scene], int], length_s: float | None = None) -> Fault:
    """Return a fault that suspends a process and then resumes it."""

    def fault(scene: Scene) -> tuple[float, float]:
        one = pid(scene)
        at_s = time.monotonic()
        os.kill(one, signal.SIGSTOP)
        try:
            time.sleep(length_s or scene.max_age_s + BEYOND_S)
        finally:
            if isinstance(scene.operator, UncheckedOperator):
                scene.operator.release()
            os.kill(one, signal.SIGCONT)
        return at_s, time.monotonic()

    return fault


def repeats_then_hangs(scene: Scene) -> tuple[float, float]:
    """Suspend a program while it repeats its last input; the fault starts with that input."""
    operator = scene.operator
    assert isinstance(operator, ScriptOperator | FoxgloveOperator)
    given_s = operator.release()
    time.sleep(max(0.0, given_s + REPEATED_S - time.monotonic()))
    os.kill(operator.pid, signal.SIGSTOP)
    try:
        time.sleep(scene.max_age_s + BEYOND_S)
    finally:
        os.kill(operator.pid, signal.SIGCONT)
    return given_s, time.monotonic()


def pings_lost(scene: Scene) -> tuple[float, float]:
    """Stall the link from the adapter to its client, which continues publishing."""
    assert isinstance(scene.operator, FoxgloveOperator)
    length_s, at_s = scene.max_age_s + BEYOND_S, time.monotonic()
    scene.operator.link.stall(length_s, (Direction.DOWN,))
    time.sleep(length_s - 0.1)
    scene.operator.release()
    return at_s, at_s + length_s


def _gateway(scene: Scene) -> int:
    assert isinstance(scene.operator, PageBehindGateway)
    return scene.operator.gateway_pid


def _page(scene: Scene) -> int:
    assert isinstance(scene.operator, PageBehindGateway)
    return scene.operator.page_pid


def _node(scene: Scene) -> int:
    assert scene.node is not None
    return scene.node().process.pid


CAUSES: Mapping[str, Cause] = {
    cause.name: cause
    for cause in (
        Cause("both", "link lost both ways", "page", stalled(Direction.UP, Direction.DOWN)),
        Cause("downlink", "downlink lost", "page", stalled(Direction.DOWN)),
        Cause("uplink", "uplink lost", "page", stalled(Direction.UP)),
        Cause("frozen", "downlink lost, raw commands", "raw", stalled(Direction.DOWN)),
        Cause("raw-both", "link lost, raw commands", "raw", stalled(Direction.UP, Direction.DOWN)),
        Cause("page-stop", "page SIGSTOP", "page", hung(_page)),
        Cause("gateway-stop", "gateway SIGSTOP", "page", hung(_gateway)),
        Cause("page-kill", "page SIGKILL", "page", killed(_page)),
        Cause("gateway-kill", "gateway SIGKILL", "page", killed(_gateway)),
        Cause("script", "script hangs, SIGSTOP 0.17 s later", "script", repeats_then_hangs),
        Cause("foxglove-stop", "last twist, adapter SIGSTOP", "foxglove", repeats_then_hangs),
        Cause("foxglove-pings", "adapter to client lost", "foxglove", pings_lost),
        Cause("node-stop", "node SIGSTOP 0.5 s", "node", hung(_node, 0.5)),
        Cause("node-long-stop", "node SIGSTOP 1.5 s", "node", hung(_node, 1.5)),
        Cause("node-kill", "node SIGKILL", "node", killed(_node)),
    )
}


@dataclass(frozen=True)
class Task:
    """Task of a process: faults to measure on a robot with a lease."""

    robot: str
    max_age_s: float
    causes: tuple[str, ...]
    runs: int


@dataclass
class Result:
    """Distances for a cause."""

    cause: str
    speed_mps: float = 0.0
    ways_m: list[float] = field(default_factory=list[float])
    failure: str = ""


def measure(task: Task) -> list[Result]:
    """Run a task; after a failure, its remaining results are marked as not measured."""
    robot, text = quick_description(task.robot)
    kind = CAUSES[task.causes[0]].operator
    opened = with_board if kind == "node" else on_a_link
    results = {name: Result(name) for name in task.causes}
    failure = ""
    with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as stack:
        path = Path(folder) / f"{task.robot}.toml"
        path.write_text(text, encoding="utf-8")
        try:
            scene = stack.enter_context(opened(robot, path, task.max_age_s, kind))
            for name, result in results.items():
                for run in range(task.runs):
                    seed = f"{task.robot} {task.max_age_s} {name} {run}"
                    phase_s = random.Random(seed).uniform(0.0, PHASE_S)  # noqa: S311
                    _run(scene, CAUSES[name], robot, result, phase_s)
        except (TimeoutError, AssertionError, OSError, TwinError) as error:
            failure = f"{type(error).__name__}: {error}".splitlines()[0][:100]
    for result in results.values():
        if len(result.ways_m) < task.runs:
            result.failure = failure
    return list(results.values())


def _run(
    scene: Scene, cause: Cause, robot: RobotDescription, result: Result, phase_s: float
) -> None:
    """Add a distance; runs with a stop before the fault are repeated."""
    twist_scale_m, why = robot.kinematics().twist_scale_m, ""
    for _ in range(ATTEMPTS):
        if scene.start_node is not None:
            scene.start_node()
        try:
            speed_mps = _get_fast(scene, twist_scale_m)
        except TimeoutError as error:
            why = str(error)
            scene.operator.release()
            continue
        time.sleep(phase_s)
        fault_s, over_s = cause.fault(scene)
        scene.track.until_rest_after(over_s + WATCHED_S)
        scene.operator.release()
        if scene.track.was_fast_at(fault_s, speed_mps):
            result.speed_mps = speed_mps
            result.ways_m.append(scene.track.distance_since(fault_s))
            return
        why = "the robot stopped before the fault"
    raise TimeoutError(f"{why}, {ATTEMPTS} times in a row")


def _get_fast(scene: Scene, twist_scale_m: float) -> float:
    """Drive until the robot reaches the speed limit of its lease; return the limit, m/s."""
    scene.operator.get_ready(scene.max_age_s)
    time.sleep(0.15)  # An earlier status does not include the lease's speed limit.
    status = scene.status()
    if status.mode != "ready" or status.lease.holder is None:
        raise TimeoutError(f"the robot is {status.mode}, and has given control away")
    scene.operator.push(HASTE * status.limits.speed_mps / twist_scale_m)
    scene.track.until_fast(status.limits.speed_mps)
    return status.limits.speed_mps


def quick_description(name: str) -> tuple[RobotDescription, str]:
    """Return a shipped robot whose speed controllers arm immediately, and its text."""
    text = robots.read_description(name)
    if robots.parse_description(text, name).arming_hold_s > 0.1:
        text = text.replace("[motor]", "[motor]\narming_hold_s = 0.1", 1)
    return robots.parse_description(text, name), text


def rows(
    names: Sequence[str] = (),
    causes: Sequence[str] = (),
    leases: Sequence[float] = MAX_AGES_S,
    runs: int = 1,
    together: int = 4,
) -> Iterator[Row]:
    """Yield a row per robot, lease and cause; one run of all takes about 200 s."""
    chosen = [CAUSES[name] for name in causes or CAUSES]
    kinds = {
        kind: tuple(c.name for c in chosen if c.operator == kind)
        for kind in ("page", "raw", "script", "foxglove", "node")
    }
    tasks = [
        Task(name, max_age_s, of_kind, runs)
        for kind, of_kind in kinds.items()
        if of_kind
        for name in names or robots.robot_names()
        for max_age_s in ([_default_age_s(name)] if kind == "foxglove" else leases)
    ]
    # Spawn, because a process that has opened a bus has threads and cannot be forked.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(together, mp_context=context) as pool:
        for task, results in zip(tasks, pool.map(measure, tasks), strict=True):
            for result in results:
                yield row(task, result)


def _default_age_s(name: str) -> float:
    """Return the maximum command age with the lease of an adapter next to its client."""
    return robots.load_robot(name).limits.max_command_age_s


def row(task: Task, result: Result) -> Row:
    """Return the worst of all runs, with the guarantee in the robot's description."""
    allowed_m = robots.load_robot(task.robot).limits.stop_allowance_m
    cause = CAUSES[result.cause].text
    text = f"{cause}, lease {task.max_age_s:g} s"
    promise = f"stands within {allowed_m:.2f} m"
    if result.failure or not result.ways_m:
        return Row(text, promise, result.failure or "not measured", False, task.robot)
    worst_m, median_m = max(result.ways_m), statistics.median(result.ways_m)
    of = f", median {median_m:.3f} of {len(result.ways_m)}" if len(result.ways_m) > 1 else ""
    measured = f"{worst_m:.3f} m{of}, from {result.speed_mps:.2f} m/s"
    return Row(text, promise, measured, worst_m <= allowed_m, task.robot, worst_m)


def main() -> None:
    """Print the table row by row; exit with 1 if a guarantee was violated."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=10, help="of each; default 10")
    parser.add_argument("--robots", default=",".join(robots.robot_names()), help="default: all")
    parser.add_argument("--causes", default=",".join(CAUSES), help="default: all")
    parser.add_argument("--leases", default=",".join(map(str, MAX_AGES_S)), help="max_age_s")
    parser.add_argument("--together", type=int, default=4, help="robots at a time; default 4")
    args = parser.parse_args()
    leases = [float(text) for text in args.leases.split(",")]
    broken, start_s = 0, time.monotonic()
    table = rows(args.robots.split(","), args.causes.split(","), leases, args.runs, args.together)
    for line in table:
        print(line, flush=True)
        broken += not line.held
    verdict = f"{broken} broken" if broken else "all held"
    print(f"{verdict}, {time.monotonic() - start_s:.0f} s")
    sys.exit(1 if broken else 0)


if __name__ == "__main__":
    main()
