"""Dynamixel servos on a serial line of the PC: find them, check and write their settings."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from struct import Struct
from typing import Any

from tsd_twin.hardware.cables import CableMonitor, missing_mask
from tsd_twin.hardware.dynamixel.packets import ALERT, StatusPacket, protocol1, protocol2
from tsd_twin.hardware.dynamixel.servo_models import (
    MODEL_NUMBER,
    ServoModel,
    ServoSetting,
    span,
    wrong_setting,
)
from tsd_twin.hardware.link_health import LinkHealth
from tsd_twin.hardware.serial_transport import HardwareError, SerialTransport
from tsd_twin.messages.sentences import sentence

SERVO_BAUD = 1_000_000
RETURN_DELAY = 9
"""Response delay in units of 2 us; factory default 250."""
TORQUE_ENABLE = 64
"""If 1, addresses below 64 are read-only."""
BUS_WATCHDOG = 98
"""Time without a request until the servo stops, in units of 20 ms; then reads 255 until 0 is
written. It counts only while torque is on, and any packet on the bus resets it.
"""
BUS_WATCHDOG_S = 0.02
WATCHDOG_EXPIRED = 255
WATCHDOG = 10
"""200 ms, shorter than the timeout of the controller board. For gimbals, which it stops where they
are."""
WHEEL_WATCHDOG = 5
"""100 ms, the silence that is a fault anyway: a wheel whose data wire is off hears no other end."""
PRESENT = 126
_LAYOUT = Struct("<hiiiiHB")
PRESENT_SIZE = _LAYOUT.size
MEASURED = (PRESENT, PRESENT_SIZE)
ALIVE_S = 0.05
"""Maximum age of a response from a live servo, as on the board."""
ANSWER_S = 0.02
"""Response timeout of a cycle."""
_AGAIN_S = 0.01
"""Response timeout of servos that are asked again in the same cycle."""
_TRY_S = 0.1
"""Response timeout of a servo during configuration."""
_TRIES = 3
_WRITTEN = (RETURN_DELAY, BUS_WATCHDOG)
"""Settings written by this program."""


@dataclass(frozen=True, slots=True)
class ServoMeasurement:
    """Measurements of a servo."""

    received_s: float
    position: int
    """Position in steps."""
    velocity_units: int
    """Velocity in units of 0.229 rpm."""
    current_units: int
    """Register 126: current in units of `ServoModel.current_ma`, or the load."""
    voltage_v: float
    temperature_c: int

    @staticmethod
    def unpack(data: bytes, received_s: float) -> ServoMeasurement:
        """Decode the `PRESENT_SIZE` bytes starting at `PRESENT`."""
        current, velocity, position, _, _, voltage, temperature = _LAYOUT.unpack(data)
        volts = voltage / 10.0
        return ServoMeasurement(received_s, position, velocity, current, volts, temperature)


@dataclass(frozen=True, slots=True)
class ServoReport:
    """Latest measurements of the servos, by index from 0."""

    present: Mapping[int, ServoMeasurement]
    newest_s: float
    faults: int = 0
    """Mask of servos with a hardware error."""
    limp: int = 0
    """Mask of servos with torque off."""

    def alive(self, now_s: float) -> int:
        """Return the mask of servos that responded within `ALIVE_S`."""
        return sum(1 << i for i, it in self.present.items() if now_s - it.received_s <= ALIVE_S)

    @property
    def hottest_c(self) -> float:
        """Temperature of the hottest servo."""
        return float(max(servo.temperature_c for servo in self.present.values()))

    def status(self, count: int, now_s: float) -> dict[str, Any]:
        """Return the facts about `count` servos for the hardware section of the status."""
        alive, present = self.alive(now_s), [self.present[i] for i in sorted(self.present)]
        return {
            "alive": [bool(alive >> i & 1) for i in range(count)],
            "voltage_v": [round(servo.voltage_v, 1) for servo in present],
            "temperature_c": [servo.temperature_c for servo in present],
        }


class ServoLine:
    """Requests to single servos; all methods block and belong to the I/O thread."""

    def __init__(
        self,
        ids: Sequence[int],
        names: Sequence[str],
        models: Mapping[int, ServoModel],
        other_protocol: str,
    ) -> None:
        """`other_protocol` is the remedy for a servo that speaks Protocol 1.0."""
        self.ids = list(ids)
        self._order = list(ids)
        """Ids in the order in which they are asked."""
        self._answered = list(ids)
        """Ids that answered last."""
        self._names = list(names)
        self._models = models
        self._other_protocol = other_protocol

    def bit(self, device: int) -> int:
        """Return the mask of a servo by its id."""
        return 1 << self.ids.index(device)

    def named(self, device: int) -> str:
        """Return a servo's number and joint, as parameter of a reason."""
        i = self.ids.index(device)
        return f"{i + 1} ({self._names[i]})"

    def to_all(self, address: int, data: Sequence[bytes]) -> bytes:
        """Return the request that writes a register of all servos."""
        return protocol2.sync_write(address, dict(zip(self.ids, data, strict=True)))

    def read_all(
        self,
        transport: SerialTransport,
        request: bytes,
        span: tuple[int, int],
        add: Callable[[Sequence[StatusPacket]], None],
    ) -> tuple[list[int], bool]:
        """Read `span` (address, size) from all servos and pass the answers to `add`.

        A servo may wait for the answer of the one before it in the request. Those behind the first
        that is missing are asked again, and it is last in the next request, where no other waits
        for it. Returns the ids of the servos that answered, and whether answers to the request
        before this one arrived.

        Raises:
            HardwareError: If the port is gone.
        """
        late = transport.late
        request += protocol2.sync_read(self._order, *span)
        answers = transport.request(request, len(self._order), ANSWER_S)
        is_late = transport.late > late
        add(answers)
        answered = {answer.id for answer in answers}
        missing = [device for device in self._order if device not in answered]
        if missing:
            self._order.remove(missing[0])
            self._order.append(missing[0])
        if again := [device for device in missing[1:] if device in self._answered]:
            answers = transport.request(protocol2.sync_read(again, *span), len(again), _AGAIN_S)
            add(answers)
            answered |= {answer.id for answer in answers}
        self._answered = [device for device in self._order if device in answered]
        return self._answered, is_late

    def measured(
        self, answers: Sequence[StatusPacket], faults: int, now_s: float
    ) -> tuple[dict[int, ServoMeasurement], int]:
        """Return the measurements in answers to `MEASURED`, by index, and the updated `faults`."""
        present: dict[int, ServoMeasurement] = {}
        for answer in answers:
            if answer.id in self.ids and len(answer.data) == PRESENT_SIZE:
                bit = self.bit(answer.id)
                faults = faults | bit if answer.error & ALERT else faults & ~bit
                present[self.ids.index(answer.id)] = ServoMeasurement.unpack(answer.data, now_s)
        return present, faults

    def find(self, transport: SerialTransport, device: int) -> None:
        """Wait for a servo's response.

        Raises:
            HardwareError: If it does not respond or speaks Protocol 1.0.
        """
        for _ in range(_TRIES):
            if transport.request(protocol2.ping(device), 1, _TRY_S):
                return
        servo = f"servo {self.named(device)}"
        if transport.request(protocol1.ping(device), 1, _TRY_S, protocol1):
            raise HardwareError(f"{servo} speaks Protocol 1.0: {self._other_protocol}")
        raise HardwareError(
            f"{servo} does not answer at {transport.name} at {SERVO_BAUD} Bd: "
            f"has it power, id {device} and this rate?"
        )

    def check_settings(self, transport: SerialTransport, device: int) -> ServoModel:
        """Return a servo's model after checking the settings that must be configured manually.

        Raises:
            HardwareError: If a setting is wrong.
        """
        servo = self.named(device)
        number = int.from_bytes(self.read(transport, device, MODEL_NUMBER, 2), "little")
        if number not in self._models:
            wrong = wrong_setting(servo, number, MODEL_NUMBER, number, self._models)
            raise HardwareError(sentence(wrong))
        model = self._models[number]
        for group in model.reads():
            data = self.read(transport, device, group[0].address, span(group))
            self._check(servo, number, group, data)
        return model

    def _check(self, servo: str, number: int, group: Sequence[ServoSetting], data: bytes) -> None:
        for setting in group:
            found = setting.value(data)
            data = data[setting.size :]
            if setting.address not in _WRITTEN and not setting.allows(found):
                wrong = wrong_setting(servo, number, setting.address, found, self._models)
                raise HardwareError(sentence(wrong))

    def read(self, transport: SerialTransport, device: int, address: int, size: int) -> bytes:
        """Return registers of a servo.

        Raises:
            HardwareError: If the servo refuses or does not respond.
        """
        return self.request(transport, device, protocol2.read(device, address, size), size).data

    def write(
        self, transport: SerialTransport, device: int, address: int, value: int, size: int = 1
    ) -> None:
        """Write a register of a servo.

        Raises:
            HardwareError: If the servo refuses or does not respond.
        """
        data = value.to_bytes(size, "little", signed=value < 0)
        self.request(transport, device, protocol2.write(device, address, data))

    def request(
        self, transport: SerialTransport, device: int, request: bytes, size: int = 0
    ) -> StatusPacket:
        """Return the response with `size` bytes.

        Raises:
            HardwareError: If the servo refuses or does not respond.
        """
        for _ in range(_TRIES):
            for answer in transport.request(request, 1, _TRY_S):
                if answer.error & ~ALERT:
                    raise HardwareError(
                        f"servo {self.named(device)} refuses its set-up: "
                        f"error {answer.error & ~ALERT}"
                    )
                if len(answer.data) == size:  # Otherwise it belongs to an earlier request.
                    return answer
        raise HardwareError(f"servo {self.named(device)} fell silent")


class ServoExchange:
    """Requests to all servos of a line, and the health of line and cables by their answers."""

    baud = SERVO_BAUD

    def __init__(self, line: ServoLine, cables: CableMonitor, clock: Callable[[], float]) -> None:
        self.health = LinkHealth("servo_bus")
        self.cables = cables
        self.cycled_s = 0.0
        """End of the latest exchange: a servo is silent only while it is asked."""
        self._line, self._clock = line, clock

    def _exchange(self, transport: SerialTransport, request: bytes, began_s: float) -> bool:
        """Send goals and read measurements and states; return whether any servo responded.

        Raises:
            HardwareError: If the port is gone.
        """
        broken = transport.broken
        answered, late = self._line.read_all(transport, request, MEASURED, self._add_responses)
        now_s, is_broken = self._clock(), transport.broken > broken
        self.cycled_s = now_s
        missing = missing_mask(self._line.ids, answered)
        self.cables.add_cycle(missing, now_s, broken=is_broken, late=late)
        self._read_state(transport, answered)
        self.health.add_packets(transport.broken > broken, now_s)
        if missing:
            self.health.add_timeout()
        else:
            self.health.add_round_trip(now_s - began_s)
        return bool(answered)

    def _add_responses(self, answers: Sequence[StatusPacket]) -> None:
        """Update the report."""
        raise NotImplementedError

    def _read_state(self, transport: SerialTransport, answered: list[int]) -> None:
        """Read the slowly changing state of the servos that answered.

        To wait for the others would delay the next cycle until all servos count as silent.
        """
        raise NotImplementedError
