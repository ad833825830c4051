"""The shared table of all fault tests."""

from __future__ import annotations

from collections.abc import Generator

import pytest

from tests.system.fault_stage import Table


@pytest.fixture(scope="session")
def table(request: pytest.FixtureRequest) -> Generator[Table]:
    """Print the table at the end."""
    it = Table()
    yield it
    plugins = request.config.pluginmanager
    terminal, capture = map(plugins.get_plugin, ("terminalreporter", "capturemanager"))
    assert terminal is not None
    assert capture is not None
    with capture.global_and_fixture_disabled():
        terminal.ensure_newline()
        for line in it.lines():
            terminal.write_line(line.rstrip())
