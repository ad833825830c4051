"""Scripts in docs/python.md run; its errors and methods match the library."""

from __future__ import annotations

import re
from collections.abc import Generator
from pathlib import Path

import pytest

import tsd_twin
from tests.support.markdown_pages import code, page, quoted, section, tables
from tests.support.programs import mock_robot, run_script
from tsd_twin import __all__
from tsd_twin.bus import DEFAULT_ENDPOINT
from tsd_twin.client.protocol import SETPOINT_TIMEOUT_S, STATUS_TIMEOUT_S

PAGE = page("python.md")
SCRIPTS = code(PAGE, "python")


@pytest.fixture(scope="module")
def endpoint() -> Generator[str]:
    with mock_robot() as mock:
        yield mock.ready().split()[-1]


@pytest.mark.system
@pytest.mark.parametrize("number", range(len(SCRIPTS)))
def test_every_script_runs(number: int, endpoint: str, tmp_path: Path) -> None:
    """With the mock on a free port instead of the default endpoint."""
    text = re.sub(r"(connect(_async)?)\(\)", rf'\1("{endpoint}")', SCRIPTS[number])
    script = tmp_path / "script.py"
    script.write_text(text, encoding="utf-8")
    run_script(script, tmp_path)


def test_every_error_of_the_library_is_in_the_table() -> None:
    (rows,) = tables(section(PAGE, "## Errors"))
    named = {name for row in rows for name in quoted(row[0])}
    errors = {
        name
        for name in __all__
        if isinstance(value := getattr(tsd_twin, name), type) and issubclass(value, Exception)
    }
    assert named == errors - {"TwinError", "ClientError"}


def test_every_method_of_the_table_is_one_and_every_motion_is_there() -> None:
    (rows,) = tables(section(PAGE, "## Drive"))
    named = {call.split("(")[0] for row in rows for call in quoted(row[0])}
    assert all(hasattr(tsd_twin.RobotControl, name) for name in named)
    assert named == {
        *("drive", "go_to", "follow_path", "set_velocity", "turn", "set_turn_rate", "rest")
    }


def test_the_figures_are_those_in_force() -> None:
    limits = tsd_twin.load_robot("tsd").limits
    assert f"expires after {SETPOINT_TIMEOUT_S:g} s" in PAGE
    assert f"`limits.command_timeout_s` ({limits.command_timeout_s:g} s)" in PAGE
    assert f"`{DEFAULT_ENDPOINT}`" in PAGE
    assert STATUS_TIMEOUT_S == 1.0
    assert "no status for a second" in PAGE
