"""Test setups for faults: a robot with a link, dashboard, page, node and board."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable, Generator, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from attack.client_operators import FoxgloveOperator, ScriptOperator
from attack.operators import Operator, PageBehindGateway, UncheckedOperator
from attack.track import DistanceLog, TruthRecorder
from tests.support.programs import Program
from tsd_twin.bus import Bus, client_config
from tsd_twin.lie import SO3
from tsd_twin.link_emulation import LinkEmulator, LinkSpec
from tsd_twin.messages.status import RobotStatus
from tsd_twin.robots import RobotDescription

ANY_PORT = "tcp/127.0.0.1:0"


@dataclass
class Scene:
    """Test setup: a robot, its operator, and the parts that can fail."""

    track: DistanceLog
    operator: Operator
    status: Callable[[], RobotStatus]
    max_age_s: float
    link: LinkEmulator | None = None
    node: Callable[[], Program] | None = None
    start_node: Callable[[], None] | None = None


@contextlib.contextmanager
def on_a_link(robot: RobotDescription, path: Path, max_age_s: float, kind: str) -> Generator[Scene]:
    """Run `tsd-mock` and an operator behind an emulated link."""
    flags = ["--listen", ANY_PORT, "--robot", str(path), "--id", robot.name]
    with contextlib.ExitStack() as stack:
        mock = Program(["tsd_mock", *flags])
        stack.callback(mock.clean_up)
        (endpoint,) = re.findall(r"tcp/[\d.:]+", mock.ready())
        link = stack.enter_context(LinkEmulator(LinkSpec(), ANY_PORT, endpoint))
        bus = stack.enter_context(Bus(client_config([endpoint])))
        recorder = TruthRecorder(bus, robot.name, robot.kinematics())
        operator: Operator
        if kind == "raw":
            operator = UncheckedOperator(link.endpoint, robot.name)
        elif kind == "script":
            operator = ScriptOperator(link.endpoint, robot.name)
        elif kind == "foxglove":
            turning = robot.kinematics().pose_type is SO3
            operator = FoxgloveOperator(link.endpoint, turning, lambda: recorder.status)
        else:
            operator = PageBehindGateway(link.endpoint)
        stack.callback(operator.close)
        yield Scene(recorder.track, operator, lambda: recorder.status, max_age_s, link)


@contextlib.contextmanager
def with_board(
    robot: RobotDescription, path: Path, max_age_s: float, _kind: str
) -> Generator[Scene]:
    """Run a board, a node and an unchecked operator; the board outlives the node."""
    track = DistanceLog()
    with contextlib.ExitStack() as stack:
        arguments = [str(path), str(path.parent)]
        board = BoardProgram(["attack.machine", "board", *arguments], track)
        stack.callback(board.clean_up)
        board.ready()
        scene = Scene(track, NoOperator(), _silence, max_age_s)
        nodes: list[Program] = []

        def start_node() -> None:
            if nodes and nodes[-1].process.poll() is None:
                return
            scene.operator.close()
            nodes.append(Program(["attack.machine", "node", *arguments]))
            stack.callback(nodes[-1].clean_up)
            raw = UncheckedOperator(nodes[-1].ready().removeprefix("ready: "), robot.name)
            scene.operator = raw
            scene.status = lambda: raw.status

        scene.node, scene.start_node = lambda: nodes[-1], start_node
        stack.callback(lambda: scene.operator.close())
        yield scene


def _silence() -> RobotStatus:
    return RobotStatus("silent")


class NoOperator:
    """Placeholder operator before the first node runs."""

    def get_ready(self, max_age_s: float) -> None:
        """Raise an error."""
        raise AssertionError(f"no node, no lease of {max_age_s:g} s")

    def push(self, x: float) -> None:
        """Do nothing."""

    def release(self) -> None:
        """Do nothing."""

    def close(self) -> None:
        """Do nothing."""


class BoardProgram(Program):
    """Process of the board, which prints the distance driven."""

    def __init__(self, arguments: list[str], track: DistanceLog) -> None:
        self._track = track
        super().__init__(arguments)

    def _read(self, stream: Iterable[str], into: list[str]) -> None:
        super()._read(self._others(stream), into)

    def _others(self, stream: Iterable[str]) -> Iterator[str]:
        for line in stream:
            if line.startswith("at "):
                self._track.add(*map(float, line.split()[1:]))
            else:
                yield line
