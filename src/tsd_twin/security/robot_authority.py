"""Checks and strips signatures at a robot node, before the controller."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence

import msgspec

from tsd_twin.errors import TwinError
from tsd_twin.messages.codes import Code, Reason, because
from tsd_twin.messages.events import Event
from tsd_twin.messages.services import LeaseReply, Reply, encode_refusal
from tsd_twin.messages.topics import Sample, Service
from tsd_twin.security.command_authority import CommandAuthority
from tsd_twin.security.operator_list import OperatorFile

_LOG = logging.getLogger(__name__)
_POLL_S = 0.2
_REPORT_S = 1.0


class RobotAuthority:
    """Checks signatures for a node, and reads the list of operators again when it changes."""

    def __init__(self, robot_id: str, operators: OperatorFile) -> None:
        self._operators = operators
        self._authority = CommandAuthority(robot_id, operators.current)
        self._polled_s = -1.0
        self._reported_s: dict[str, float] = {}
        self._events: list[Event] = []

    def signed_commands(self, samples: Sequence[Sample], now_s: float) -> list[Sample]:
        """Return the commands whose signature is right, without it; call in every period."""
        self._poll(now_s)
        kept: list[Sample] = []
        for sample in samples:
            checked = self._authority.check_command(sample)
            if isinstance(checked, Sample):
                kept.append(checked)
            else:
                self._report("drop", because(Code.COMMAND_DROPPED, checked), checked, now_s)
        return kept

    def serve(
        self,
        service: Service,
        payload: bytes,
        now_s: float,
        serve: Callable[[Service, bytes, float], LeaseReply | Reply],
    ) -> bytes:
        """Return the reply to a request; `serve` processes it if its signature is right."""
        checked = self._authority.check_request(service, payload, now_s)
        if isinstance(checked, Reason):
            self._report("refusal", checked, checked, now_s)
            return encode_refusal(service, checked)
        return msgspec.json.encode(self._authority.complete(serve(service, checked, now_s)))

    def record_status(self, number: int, now_s: float) -> None:
        """Record the time at which a status was sent."""
        self._authority.record_status(number, now_s)

    def take_events(self) -> list[Event]:
        """Return the events since the last call."""
        events, self._events = self._events, []
        return events

    def _poll(self, now_s: float) -> None:
        if now_s - self._polled_s < _POLL_S:
            return
        self._polled_s = now_s
        try:
            changed = self._operators.poll()
        except TwinError as error:
            _LOG.warning("%s", error)
            why = because(Code.OPERATORS_UNUSABLE, text=str(error)[:200])
            self._report("refusal", why, why, now_s)
            return
        if changed is not None:
            self._authority.set_operators(changed)

    def _report(self, kind: str, why: Reason, rule: Reason, now_s: float) -> None:
        if now_s - self._reported_s.get(rule.code, -_REPORT_S) >= _REPORT_S:
            self._reported_s[rule.code] = now_s
            self._events.append(Event.of(kind, why, rule.code, now_s))
