"""A stop of the robot that is over before anybody looks is a stop all the same."""

from __future__ import annotations

from msgspec.structs import replace

from tests.support.page_client import site
from tsd_twin.dashboard.server.protocol import RobotState
from tsd_twin.dashboard.server.session import Session

BY_ITSELF = "the robot has stopped by itself"


async def say_once_more(session: Session, state: RobotState) -> None:
    """Let the session hear a state that differs from the last by a stop."""
    status = replace(state.status, stops=state.status.stops + 1)
    session.send_state(replace(state, status=status))


def test_a_stop_between_two_states_that_both_say_driving_lets_go() -> None:
    """The robot counts its stops: it may have stopped and begun again since the last word of it."""
    with site() as served, served.page() as page:
        page.make_ready()
        sessions, reasons = served.sessions, list[str]()
        while BY_ITSELF not in reasons:  # On a busy machine it may be let go for silence before.
            assert len(reasons) < 20, reasons
            before = len(page.all("released"))
            page.send(t="release")
            page.drive()
            state = sessions.directory.state("tsd")
            assert state is not None
            assert state.status.mode in ("driving", "stopping", "ready")
            driving = replace(state, status=replace(state.status, mode="driving"))
            served.run(say_once_more(sessions._sessions[page.name], driving))
            page.until(lambda count=before: len(page.all("released")) > count)
            reasons.append(page.last("released")["reason"])
            page.until(lambda: page.mode == "ready")
