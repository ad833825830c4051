"""Every module that can command a robot is in the table of sources or excluded with a reason.

The modules are found in the code, so that a new source cannot be forgotten.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.laws.source_table import DEVIATIONS, NO_SOURCES, SOURCES, documented
from tests.support.markdown_pages import page, section
from tsd_twin.hardware.dynamixel.control_table import BoardMode

ROOT = Path(__file__).parents[2]
LISTED = {module for source in SOURCES for module in source.modules}
CALLS = {"set_velocity", "set_turn_rate", "driving", "go_to", "follow_path"} | {
    "publisher",
    "declare_publisher",
}
"""Methods that command a motion, or publish on any key of the bus."""
TIMED = {"drive", "turn"}
"""Methods that command a motion for a time; other classes use these names, too."""
KEY = r"\S*/cmd/[^*\s]\S*"
"""Key of a command, without patterns."""
MADE = {"CmdVelBridge", "JointCommand", "TwistCommand"}
"""Classes used only to command a robot."""


def commands(text: str) -> set[str]:
    """Return the names by which a program text can command a robot."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Call):
            called = node.func
            if isinstance(called, ast.Attribute):
                owner = ast.unparse(called.value)
                if owner in MADE:  # A method that makes one.
                    found.add(owner)
                is_protocol = "protocol" in owner
                is_timed = any(each.arg == "duration_s" for each in node.keywords)
                if (
                    called.attr in CALLS
                    or (called.attr in TIMED and is_timed)
                    or (called.attr == "command" and is_protocol)
                ):
                    found.add(called.attr)
            elif isinstance(called, ast.Name) and called.id in MADE:
                found.add(called.id)
        elif isinstance(node, ast.Attribute | ast.Name):
            # A command key in a string, for a third-party session.
            if (name := getattr(node, "attr", getattr(node, "id", ""))) == "twist_key":
                found.add(name)
        elif isinstance(node, ast.Constant) and re.fullmatch(KEY, str(node.value)):
            found.add("/cmd/")
    return found


def modules() -> Iterator[tuple[str, str]]:
    """Yield name and text of every shipped module."""
    for folder in ("src", "app"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            parts = path.relative_to(ROOT / folder).with_suffix("").parts
            yield ".".join(parts), path.read_text("utf-8")


def unlisted(shipped: Iterator[tuple[str, str]]) -> dict[str, set[str]]:
    """Return the modules that can command a robot and are not listed."""
    can = {name: found for name, text in shipped if (found := commands(text))}
    return {name: found for name, found in can.items() if name not in LISTED | set(NO_SOURCES)}


def test_every_module_that_can_command_a_robot_is_listed() -> None:
    assert unlisted(modules()) == {}


def test_every_module_that_is_listed_can_command_a_robot() -> None:
    can = {name for name, text in modules() if commands(text)}
    listed = {name for name in LISTED | set(NO_SOURCES) if not name.startswith("BoardMode")}
    assert listed <= can
    assert not LISTED & set(NO_SOURCES)


@pytest.mark.parametrize(
    "planted",
    [
        "async def follow(control):\n    control.set_velocity(vx_mps=0.1)",
        "def talk(bus):\n    bus.publisher('twin/tsd/cmd/x/twist', 1).put(b'')",
        "def send(self):\n    self._link.send(self._protocol.command((1, 0, 0), 'odom', 0.0))",
        "def show(base):\n    base.drive(vx_mps=0.1, duration_s=1.0)",
        "async def home(base):\n    await base.go_to(x_m=0.0, y_m=0.0)",
        "def follow(base):\n    for _ in base.driving(lambda _: (0.1, 0.0, 0.0)):\n        pass",
        "def push(session):\n    session.put('twin/tsd/cmd/x/twist', b'')",
        "def push(session, robot):\n    session.put(topics.twist_key(robot, 'x'), b'')",
        "def move(board):\n    board.command = JointCommand(setpoint, beat, 0.0)",
        "def move(board):\n    board.command = JointCommand.checked(setpoint, 3, beat, 0.0)",
    ],
)
def test_a_new_source_that_is_not_in_the_table_is_found(planted: str) -> None:
    assert list(unlisted(iter([("tsd_twin.gamepad", planted)]))) == ["tsd_twin.gamepad"]


def test_every_mode_that_the_firmware_gives_to_a_source_is_listed() -> None:
    given = {
        mode
        for path in (ROOT / "firmware").glob("*.c")
        for mode in re.findall(r"give_to\(BOARD_(\w+)\)", path.read_text("utf-8"))
    }
    assert given == {mode.name for mode in BoardMode} - {"DISARMED"}
    radio = {module.removeprefix("BoardMode.") for module in LISTED if "BoardMode" in module}
    # All sources but the radio control reach the board as the PC.
    assert radio | {"ARMED"} == given


def test_a_deviation_names_a_pair_and_has_a_reason() -> None:
    names = {source.name for source in SOURCES}
    for (source, _), deviation in DEVIATIONS.items():
        assert source in names
        assert deviation.reason.endswith(".")


def test_table_of_sources_is_documented() -> None:
    assert documented() in section(page("safety.md"), "## Sources and conditions")
