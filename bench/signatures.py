"""Cost of the signature check of a command, compared with 1 % of a core at 50 Hz."""

from __future__ import annotations

from collections.abc import Iterator

import msgspec

from bench.kinematics import each_us
from bench.table import Row, Run
from tsd_twin import robots
from tsd_twin.client.lease_signing import LeaseSigning
from tsd_twin.client.protocol import ControlProtocol
from tsd_twin.messages import topics
from tsd_twin.messages.cdr import BASE
from tsd_twin.messages.services import LeaseReply, LeaseRequest
from tsd_twin.messages.topics import Sample, Service
from tsd_twin.security.command_authority import CommandAuthority
from tsd_twin.security.operator_list import ListedOperator, OperatorList
from tsd_twin.security.signing_keys import new_signing_key, public_bytes

_LIMIT_US = 0.01 / 50 * 1e6
_LEASE = "ab" * 16


def rows(run: Run) -> Iterator[Row]:
    """Measure the check of a command, with its lease granted."""
    key = new_signing_key()
    listed = OperatorList(1, {"alice": ListedOperator((public_bytes(key).hex(),))})
    authority = CommandAuthority("lab1", listed)
    robot = robots.load_robot("tsd")
    protocol = ControlProtocol("lab1", robot, "alice", signing=LeaseSigning(key, "lab1"))
    wish = protocol.encode(Service.LEASE, LeaseRequest(op="acquire", operator="alice"))
    authority.check_request(Service.LEASE, wish, 0.0)
    reply = authority.complete(LeaseReply(True, _LEASE, "alice", max_age_s=0.2))
    protocol.grant(msgspec.convert(msgspec.to_builtins(reply), LeaseReply), 0.0)
    command = protocol.command((0.3, 0.0, 0.0), BASE, 0.0)
    sample = Sample(topics.twist_key("lab1", "alice"), command.payload, command.attachment)
    if not isinstance(authority.check_command(sample), Sample):
        raise AssertionError("the command is refused")
    calls = int(run.pick(20_000, 100))

    def check() -> list[float]:
        return [each_us(lambda: authority.check_command(sample), calls)]

    yield from run.alternate(["signatures.command"], check, lambda: [_LIMIT_US])
