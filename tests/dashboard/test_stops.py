"""A stop of the robot that is over before anybody looks is a stop all the same."""

from __future__ import annotations

from msgspec.structs import replace

from tests.dashboard.operators import site
from tests.dashboard.witnesses import Commands
from tsd_twin.dashboard.protocol import State
from tsd_twin.dashboard.session import Session


async def say_once_more(session: Session, state: State) -> None:
    """Let the session hear a state that differs from the last by a stop."""
    status = replace(state.status, stops=state.status.stops + 1)
    session.show(replace(state, status=status))


def test_a_stop_between_two_states_that_both_say_driving_lets_go() -> None:
    """The robot counts its stops: it may have stopped and begun again since the last word of it."""
    with site() as served, served.page() as page:
        page.make_ready()
        page.drive()
        commands = Commands(served, page)
        gateway = served.gateway
        state = gateway._roster.state("tsd")
        assert state is not None
        assert state.status.mode == "driving"
        served.run(say_once_more(gateway._sessions[page.name], state))
        assert page.until(lambda: page.last("released"))["reason"] == (
            "the robot has stopped by itself"
        )
        page.until(lambda: page.mode == "ready")
        assert not commands.take()[-1].twist.any()
