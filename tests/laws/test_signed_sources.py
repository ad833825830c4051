"""A robot that requires signatures refuses every source on the bus by the same code."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import pytest

from firmware.simulator.board import build_native
from tests.laws.command_sources import CommandSource, ReplayedDrive, ServosAtComputer
from tests.laws.source_table import SOURCES, Source
from tests.support.virtual_robot import VirtualRobot
from tests.support.virtual_time import VirtualClock
from tsd_twin.errors import TwinError
from tsd_twin.messages.codes import Code
from tsd_twin.messages.events import Event
from tsd_twin.security.certificates import CertificateAuthority, new_key, write_certificate
from tsd_twin.security.operator_list import (
    ListedOperator,
    OperatorFile,
    OperatorList,
    encode_list,
)
from tsd_twin.security.robot_authority import RobotAuthority
from tsd_twin.security.signing_keys import key_pem, new_signing_key, public_bytes

pytestmark = pytest.mark.filterwarnings("ignore::ResourceWarning")
ON_BUS = [
    source
    for source in SOURCES
    if source.made.on_bus and not issubclass(source.made, ReplayedDrive | ServosAtComputer)
]


@pytest.fixture(scope="module")
def native() -> Path:
    return build_native()


@pytest.fixture
def patch() -> Iterator[pytest.MonkeyPatch]:
    with pytest.MonkeyPatch.context() as it:
        yield it


@pytest.fixture
def keys(tmp_path: Path) -> Path:
    """Folder with an authority, a key, and a list that allows it to sign for all operators."""
    authority, signer = new_key(), new_signing_key()
    certificate = CertificateAuthority.new(authority, datetime.now(UTC)).certificate
    write_certificate(tmp_path / "ca.pem", certificate)
    (tmp_path / "own.sign").write_bytes(key_pem(signer))
    names = ("alice", "page", "script", "web", "foxglove", "ros", "panel")
    listed = ListedOperator((public_bytes(signer).hex(),), for_users=True)
    content = encode_list(OperatorList(1, dict.fromkeys(names, listed)), authority)
    (tmp_path / "operators.json").write_bytes(content)
    return tmp_path


class KeptAuthority(RobotAuthority):
    """Authority that keeps the rules of its events."""

    rules: frozenset[str] = frozenset()

    def take_events(self) -> list[Event]:
        events = super().take_events()
        self.rules |= {event.rule for event in events}
        return events


async def _tried(made: CommandSource) -> None:
    try:
        await made.open()
        await made.get_ready()
        await made.hold(0.5, 0.3)
    except TwinError as error:
        made.said.append(str(error))
    finally:
        await asyncio.sleep(0.1)


@pytest.mark.parametrize("signs", [False, True], ids=["unsigned", "signed"])
@pytest.mark.parametrize("source", ON_BUS, ids=[source.name for source in ON_BUS])
def test_a_source_drives_with_a_listed_key_only(
    source: Source, signs: bool, keys: Path, native: Path, patch: pytest.MonkeyPatch
) -> None:
    clock = VirtualClock(patch)
    authority = KeptAuthority(VirtualRobot.id, OperatorFile(keys / "operators.json"))
    robot = VirtualRobot(clock, native, patch, authority=authority)
    robot.network.certificate = keys / "own.pem" if signs else None
    try:
        clock.wait(2.2)  # The board holds zero throttle.
        made = source.made(robot)
        clock.run(_tried(made))
        seen = authority.rules
        if signs:
            assert robot.supervisor.gate.accepted > 0, (made.said, seen)
            assert seen == set()
        else:
            assert robot.supervisor.gate.accepted == 0
            assert robot.supervisor.lease_in_force(clock.now_s) is None
            assert seen == {Code.SIGNATURE_MISSING}
    finally:
        robot.close()
