"""Automatic stops, however short, and STOP by a page, before any other event."""

from __future__ import annotations

from msgspec.structs import replace

from tests.dashboard.recorders import settle
from tests.support.page_client import site
from tsd_twin.dashboard.sessions.session import Session
from tsd_twin.dashboard.wire.to_page import RobotState
from tsd_twin.messages.commands import decode_command
from tsd_twin.messages.status import LeaseStatus
from tsd_twin.messages.topics import Sample, Service


async def say_once_more(session: Session, state: RobotState) -> None:
    """Pass the session a state with one more stop."""
    status = replace(state.status, stops=state.status.stops + 1)
    session.decide(status)


def test_a_stop_between_two_states_that_both_say_driving_lets_go() -> None:
    """The stop counter reveals a stop and restart between two states."""
    with site() as served, served.page() as page:
        page.make_ready()
        sessions = served.sessions
        page.drive()
        state = sessions.directory.state("tsd")
        assert state is not None
        assert state.status.mode in ("driving", "stopping", "ready")
        driving = replace(state, status=replace(state.status, mode="driving"))
        served.run(say_once_more(sessions._sessions[page.name], driving))
        page.until(lambda: page.all("released"))
        assert page.last("released")["why"]["code"] == "stopped_by_itself"


def test_a_stop_is_published_before_the_controls_are_released() -> None:
    with site() as served, served.page() as page:
        sent: list[Sample] = []
        served.bus.subscribe("twin/tsd/**", sent.append)
        page.make_ready()
        page.drive()
        sent.clear()
        page.send(t="stop")
        page.until(lambda: page.mode == "stopped")
        settle(page)
        keys = [sample.key for sample in sent]
        stop = keys.index(Service.STOP.key("tsd"))
        commands = [
            number for number, key in enumerate(keys) if key.endswith(f"{page.operator}/twist")
        ]
        zeros = [number for number in commands if not decode_command(sent[number]).twist.any()]
        assert zeros
        assert stop < zeros[0]
        assert all(number < stop for number in commands if number not in zeros)


async def show_stopped(session: Session, state: RobotState) -> bool:
    """Show a stopped robot without its lease, and return whether control is held."""
    status = replace(state.status, mode="stopped", lease=LeaseStatus(holder="bob"))
    session.show(replace(state, status=status, status_seq=state.status_seq + 1))
    return session._lease_client.lease is not None


def test_what_is_shown_decides_nothing() -> None:
    """Only a status from the robot ends a motion or a lease, so it keeps driving."""
    with site() as served, served.page() as page:
        page.make_ready()
        page.drive()
        before = len(page.all("released"))
        state = served.sessions.directory.state("tsd")
        assert state is not None
        assert served.run(show_stopped(served.sessions._sessions[page.name], state))
        page.until(lambda: page.mode == "stopped")
        settle(page)
        reasons = [message["why"]["code"] for message in page.all("released")[before:]]
        # A busy machine may release the controls of a late page.
        assert not {"reset_first", "stopped_by_itself", "control_is_lost"}.intersection(reasons)
