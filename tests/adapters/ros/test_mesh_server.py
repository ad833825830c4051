"""The mesh server prints nothing when a client disconnects."""

from __future__ import annotations

from contextlib import closing

import pytest

from tsd_twin.adapters.ros.adapter import MeshServer


@pytest.mark.parametrize(
    ("error", "printed"),
    [(BrokenPipeError(), False), (ConnectionResetError(), False), (ValueError("a bug"), True)],
)
def test_a_failed_connection_is_silent_and_a_mistake_of_ours_is_not(
    error: Exception, printed: bool, capfd: pytest.CaptureFixture[str]
) -> None:
    with closing(MeshServer("127.0.0.1", 0)) as server:
        try:
            raise error
        except Exception:
            server.handle_error(None, ("127.0.0.1", 1))
    assert bool(capfd.readouterr().err) is printed
