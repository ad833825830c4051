"""Handover between operators whose names are not valid on the bus."""

from __future__ import annotations

import pytest

from tests.support.virtual_fleet import FleetPage, VirtualFleet, until
from tests.support.virtual_time import VirtualClock
from tsd_twin.dashboard.sessions.principal import DEFAULT_IDENTITY, Principal, shown_name
from tsd_twin.messages.topics import checked
from tsd_twin.security import Role
from tsd_twin.security.users import Login, User

OLGA, WANG = "a" * 16, "b" * 16


def lease_of(page: FleetPage) -> dict[str, str]:
    return page.all("state")[-1]["status"]["lease"]


def named(page: FleetPage, role: str) -> str | None:
    """Return the name that the page shows for the holder or the requester."""
    return page.all("state")[-1]["status"]["operators"].get(lease_of(page)[role])


def operator_of(page: FleetPage) -> str:
    return page.all("welcome")[-1]["operator"]


def test_control_is_handed_over_between_names_in_any_script(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    fleet = VirtualFleet(VirtualClock(monkeypatch), ["kiwi"])

    async def hand_over() -> None:
        async with (
            fleet.running(),
            fleet.page(OLGA, name="Ольга") as holder,
            fleet.page(WANG, name="王小明") as asker,
        ):
            holder.send(t="lease", op="acquire")
            await until(lambda: holder.all("state")[-1]["has_control"])
            await until(lambda: named(asker, "holder") == "Ольга")
            asker.send(t="lease", op="request")
            await until(lambda: named(holder, "requested_by") == "王小明")
            holder.send(t="lease", op="grant", requester=lease_of(holder)["requested_by"])
            await until(lambda: asker.all("state")[-1]["has_control"])
            assert lease_of(asker)["holder"] == operator_of(asker)
            for page in (holder, asker):
                assert checked(operator_of(page)) == operator_of(page)
                assert not [each for each in page.all("reply") if not each["ok"]]

    fleet.clock.run(hand_over())


def test_a_login_gives_the_name_that_is_shown() -> None:
    login = Login("id", User("bob", Role.OPERATOR, may_stop=True), 0.0, 0.0)
    assert shown_name(Principal(DEFAULT_IDENTITY, may_stop=True), " Ольга\n") == "Ольга"
    assert shown_name(Principal(DEFAULT_IDENTITY, may_stop=True, login=login), "Ольга") == "bob"
