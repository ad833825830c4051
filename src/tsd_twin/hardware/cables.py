"""Which cable is loose: answers, voltages and restarts of servos, counted and explained. Pure.

A loose contact shows long before it stops the robot. The servos that miss the same answers, and
their restarts, identify the cause: the plug of one servo, the wire to several, their supply, the
ground of the data wire, or the data wire of the whole bus.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from tsd_twin.hardware.dynamixel.control_table import SERVOS, RcChannel, ResetCause, Telemetry
from tsd_twin.hardware.joints import ServoNames
from tsd_twin.messages.codes import Code, Reason, because
from tsd_twin.messages.sentences import sentence

LEAST = 5
"""Fewest events that are a pattern: fewer may be a held-up program."""
_TOGETHER_S = 0.3
"""The board checks the torque of a single servo per cycle."""
_SHARE = 0.5
"""Fraction of a servo's missed cycles that a pattern must explain."""
DIP_SHARE = 0.8
"""Voltage relative to the usual one below which a supply has failed for a moment."""


@dataclass
class ServoAnswers:
    """Answers of a servo since the start."""

    missed: int = 0
    broken: int = 0
    """Missing in a cycle with a corrupt packet."""
    late: int = 0
    """Arrived after the cycle."""
    longest_silence_s: float = 0.0
    lowest_v: float = math.inf
    usual_v: float = 0.0
    """Slowly following average."""
    restarts: int = 0
    answered_s: float | None = None


@dataclass
class CableMonitor:
    """Counters of a servo bus, and what they say about its cables."""

    names: ServoNames
    branches: tuple[int, ...] = ()
    """Masks of servos that share a supply wire."""
    cycles: int = 0
    reconnects: int = 0
    servos: list[ServoAnswers] = field(default_factory=list[ServoAnswers])
    channels: Counter[int] = field(default_factory=Counter[int])
    """Drop-outs by mask of receiver channels."""
    _missing: Counter[int] = field(default_factory=Counter[int])
    """Cycles by mask of servos whose answers were missing."""
    _broken: Counter[int] = field(default_factory=Counter[int])
    _restarts: Counter[int] = field(default_factory=Counter[int])
    _restarted: int = 0
    _restarted_s: float = -math.inf
    _before: int = 0
    _channels_before: int = 0

    def __post_init__(self) -> None:
        self.servos = [ServoAnswers() for _ in self.names.names]

    def add_cycle(self, missing: int, now_s: float, *, broken: bool, late: bool = False) -> None:
        """Record a cycle; `late`: answers that were missing in the last cycle have arrived."""
        self.cycles += 1
        if late and self._before:
            self._reclassify_late()
        patterns = self._broken if broken else self._missing
        patterns[missing] += bool(missing)
        self._before = 0 if broken else missing
        for i, servo in enumerate(self.servos):
            if missing >> i & 1:
                servo.missed += not broken
                servo.broken += broken
                continue
            if servo.answered_s is not None:
                silence_s = now_s - servo.answered_s
                servo.longest_silence_s = max(servo.longest_silence_s, silence_s)
            servo.answered_s = now_s

    def pause(self) -> None:
        """Ignore the time until the next cycle, as after a reconnection."""
        self._before = 0
        for servo in self.servos:
            servo.answered_s = None

    def add_voltages(self, volts: Mapping[int, float]) -> None:
        """Record supply voltages, by servo."""
        for i, each in volts.items():
            servo = self.servos[i]
            servo.lowest_v = min(servo.lowest_v, each)
            servo.usual_v = (
                each if not servo.usual_v else servo.usual_v + 0.01 * (each - servo.usual_v)
            )

    def add_restarts(self, mask: int, now_s: float) -> None:
        """Record servos that have restarted; restarts within a short time are one event."""
        if not mask:
            return
        if now_s - self._restarted_s < _TOGETHER_S:
            self._restarts[self._restarted] -= 1
            mask |= self._restarted
        else:
            self._restarted = 0
        for i, servo in enumerate(self.servos):
            servo.restarts += (mask & ~self._restarted) >> i & 1
        self._restarts[mask] += 1
        self._restarted, self._restarted_s = mask, now_s

    def add_reconnect(self) -> None:
        """Record that the port was lost and came back."""
        self.reconnects += 1
        self.pause()

    def add_channels(self, missing: int, count: int) -> None:
        """Record which of `count` receiver channels are missing; all are the transmitter's."""
        new = missing & ~self._channels_before
        self._channels_before = missing
        if new and missing != (1 << count) - 1:
            self.channels[missing] += 1

    def findings(self) -> list[Reason]:
        """Return the loose cables, the most certain first."""
        found: list[Reason] = []
        if self.reconnects > 1:
            found.append(because(Code.CABLE_LINE, reconnects=self.reconnects))
        supply = self._supply()
        found += supply
        if not supply:  # Servos without power are silent, too.
            found += self._answers()
        found += self._ground()
        for mask, count in self.channels.most_common(1):
            if count >= LEAST:
                named = [RcChannel(i).name.lower() for i in range(len(RcChannel)) if mask >> i & 1]
                found.append(because(Code.CABLE_RECEIVER, channels=", ".join(named), missed=count))
        return found

    def status(self) -> dict[str, Any]:
        """Return the counters for the status, JSON-serializable."""
        servos = self.servos
        low = [servo.lowest_v for servo in servos if servo.lowest_v < math.inf]
        return {
            "answers": self.cycles,
            "missed": [servo.missed for servo in servos],
            "broken": [servo.broken for servo in servos],
            "late": [servo.late for servo in servos],
            "restarts": [servo.restarts for servo in servos],
            "longest_silence_ms": [round(1000.0 * s.longest_silence_s) for s in servos],
            "lowest_v": [round(volts, 1) for volts in low],
        }

    def sentences(self) -> list[str]:
        """Return the findings as texts."""
        return [sentence(reason) for reason in self.findings()]

    def _reclassify_late(self) -> None:
        self._missing[self._before] -= 1
        for i, servo in enumerate(self.servos):
            if self._before >> i & 1:
                servo.missed -= 1
                servo.late += 1

    def _supply(self) -> list[Reason]:
        """Find servos whose voltage fell, or that restart together."""
        low = 0
        usual = sorted(servo.usual_v for servo in self.servos)[len(self.servos) // 2]
        for i, servo in enumerate(self.servos):
            low |= (servo.lowest_v < DIP_SHARE * usual) << i
        restarts, count = next(iter(self._restarts.most_common(1)), (0, 0))
        mask = low or (restarts if count >= 2 else 0)
        if not mask:
            return []
        lowest = [self.servos[i].lowest_v for i in range(len(self.servos)) if mask >> i & 1]
        if restarts & mask:
            return [self.names.about(mask, Code.CABLE_SUPPLY)]
        return [self.names.about(mask, Code.CABLE_SUPPLY, volts=min(lowest))]

    def _answers(self) -> list[Reason]:
        """Find the servos whose answers are missing together."""
        found = [it for it in self._missing.most_common() if it[0] and it[1] >= LEAST]
        if not found:
            return []
        mask, count = found[0]
        if mask == self.names.servos and len(self.servos) > 1:
            return [because(Code.CABLE_BUS, missed=count, total=self.cycles)]
        several = mask & mask - 1
        to_the_end = mask + (mask & -mask) == self.names.servos + 1
        if mask in self.branches and not to_the_end:
            # The data wire leads on to those behind, which answer.
            return [self.names.about(mask, Code.CABLE_SUPPLY)]
        code = Code.CABLE_WIRE if several and to_the_end else Code.CABLE_PLUG
        return [self.names.about(mask, code, missed=count, total=self.cycles)]

    def _ground(self) -> list[Reason]:
        mask, count = next(iter(self._broken.most_common(1)), (0, 0))
        total = sum(self._broken.values())
        if total < LEAST:
            return []
        named = mask if count >= _SHARE * total else self.names.servos
        return [self.names.about(named, Code.CABLE_GROUND, broken=total, total=self.cycles)]


class BoardCables:
    """Cables of a controller board, from its telemetry."""

    def __init__(self, names: ServoNames, expected: int) -> None:
        """`expected` is the mask of servos that are connected to the board."""
        self.monitor = CableMonitor(names, branches_of(names))
        self.missed = [0] * SERVOS
        """Missing or invalid responses per servo since the start."""
        self._expected = expected

    def add(self, before: Telemetry, board: Telemetry, now_s: float) -> None:
        """Record telemetry, with the telemetry before it on the same connection."""
        if board.millis < before.millis:
            if board.reset_cause & (ResetCause.POWER_ON | ResetCause.BROWN_OUT):
                self.monitor.add_restarts(self._expected, now_s)  # They share a fuse.
            self.monitor.pause()
            return
        pairs = zip(before.servo_missed, board.servo_missed, strict=True)
        new = [(now - was) % 256 for was, now in pairs]
        self.missed = [count + more for count, more in zip(self.missed, new, strict=True)]
        missed = sum(1 << i for i, more in enumerate(new) if more)
        watched = self._expected & before.servo_checked
        self.monitor.add_cycle(missed & watched, now_s, broken=False)
        alive = watched & board.servo_alive
        volts = {i: v / 10.0 for i, v in enumerate(board.voltage) if alive >> i & 1 and v}
        self.monitor.add_voltages(volts)
        missing = sum(1 << i for i, us in enumerate(board.rc) if not us)
        self.monitor.add_channels(missing, len(board.rc))


def branches_of(names: ServoNames) -> tuple[int, ...]:
    """Return the masks of the servos of each module, which a star of supply wires feeds."""
    return tuple(0b11 << i for i in range(0, len(names.names), 2))


def missing_mask(ids: Sequence[int], answered: Sequence[int]) -> int:
    """Return the mask of servos, by their ids, that did not answer."""
    return sum(1 << i for i, device in enumerate(ids) if device not in answered)
