"""Six simulated MX-64 as a U2D2 has them: with sync read and bus watchdog.

`python -m tests.support.servo_chain PORT` serves them in a separate process, behind a pty, with
faults by commands: dead, hot or limp and a number from 1, unplug, mend.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from firmware.simulator.mx64 import Mx64
from firmware.simulator.servo_bus import ServoBusSimulation
from firmware.simulator.simulation import IDS
from tests.support.faulty_devices import Peer
from tsd_twin import robots
from tsd_twin.hardware import servo_line, u2d2
from tsd_twin.hardware.dynamixel.packets import Decoder, Instruction, Packet, protocol1, protocol2
from tsd_twin.simulation import Servos

_LAWS = Servos.of(
    robots.description_of_kind(robots.load_robot("tsd"), robots.SingularityDescription), 12.0
)
TRIPPED = 255
COOL_C, HOT_C = 35, 90


class ServoChain:
    """Simulated servos in real time: move towards the goals, and stop without requests."""

    def __init__(
        self,
        protocols: tuple[int, ...] = (2,) * 6,
        ids: tuple[int, ...] = IDS,
        *,
        steps: int = 0,
    ) -> None:
        """`steps`: offset of all servos from 2048."""
        self.servos = [Mx64(*servo) for servo in zip(ids, protocols, strict=True)]
        self.bus = ServoBusSimulation(self.servos)
        self.waits = False
        """Whether a servo answers a sync read only after the one before it in the request."""
        self.refused = 0
        """Goals that a tripped watchdog kept away."""
        self._decoders = (Decoder(protocol2), Decoder(protocol1))
        self._angles = np.full(6, steps * _LAWS.step_rad)
        self._heard_s = self._moved_s = 0.0

    def register(self, servo: int, address: int) -> int:
        """Return one byte of the table of a servo, counted from 0."""
        return self.servos[servo].read(address, 1)[0]

    def tripped(self) -> bool:
        """Return whether every watchdog has run out."""
        return all(self.register(i, servo_line.BUS_WATCHDOG) == TRIPPED for i in range(6))

    def goals(self) -> list[int]:
        """Return the latest goals."""
        return [servo.goal for servo in self.servos]

    def answer(self, data: bytes, now_s: float) -> bytes:
        """Return the response to received bytes."""
        self.live(now_s)
        self._heard_s = now_s
        two, one = (decoder.feed(data, now_s) for decoder in self._decoders)
        out = b"".join(self._obey(packet) for packet in two)
        for packet in one:
            answer = self.bus.answer(protocol1.encode(packet))
            out += answer[0] if answer else b""
        return out

    def _obey(self, packet: Packet) -> bytes:
        if packet.code == Instruction.SYNC_READ:
            address = int.from_bytes(packet.params[:2], "little")
            length = int.from_bytes(packet.params[2:4], "little")
            read = [protocol2.read(device, address, length) for device in packet.params[4:]]
            answers = [a and a[0] for a in map(self.bus.answer, read)]
            if self.waits and None in answers:
                answers = answers[: answers.index(None)]
            return b"".join(filter(None, answers))
        writes_goals = (
            packet.code == Instruction.SYNC_WRITE and packet.params[0] == u2d2.GOAL_POSITION
        )
        if writes_goals and self.tripped():
            self.refused += 1
            return b""
        answer = self.bus.answer(protocol2.encode(packet))
        return answer[0] if answer else b""

    def mend(self) -> None:
        """Take all injected faults away."""
        for servo in self.servos:
            servo.dead, servo.temperature_c = False, COOL_C

    def live(self, now_s: float) -> None:
        """Let time pass until now: servos move until their watchdogs run out."""
        units = self.register(0, servo_line.BUS_WATCHDOG)
        until_s = now_s
        if 0 < units < TRIPPED and now_s - self._heard_s > units * servo_line.BUS_WATCHDOG_S:
            until_s = self._heard_s + units * servo_line.BUS_WATCHDOG_S
            for servo in self.servos:
                servo.write(servo_line.BUS_WATCHDOG, bytes([TRIPPED]))
        goals = (np.array(self.goals()) - 2048) * _LAWS.step_rad
        elapsed_s = max(0.0, until_s - self._moved_s) if units != TRIPPED else 0.0
        moved = _LAWS.after(self._angles, goals, np.float64(min(elapsed_s, 1.0)))
        still = [servo.jammed or not servo.torque for servo in self.servos]
        self._angles = np.where(still, self._angles, moved)
        self._moved_s = now_s
        for servo, angle in zip(self.servos, self._angles, strict=True):
            servo.position = 2048 + round(angle / _LAWS.step_rad)


def main() -> None:
    """Serve until standard input ends."""
    chain = ServoChain()
    peer = Peer(Path(sys.argv[1]), chain.answer)
    sys.stdout.write(f"ready: {peer.port}\n")
    sys.stdout.flush()
    for line in sys.stdin:
        match line.split():
            case ["dead", number]:
                chain.servos[int(number) - 1].dead = True
            case ["hot", number]:
                chain.servos[int(number) - 1].temperature_c = HOT_C
            case ["limp", number]:
                chain.servos[int(number) - 1].switch_off()
            case ["unplug"]:
                peer.unplug()
            case _:
                chain.mend()
                peer.plug_in()
    peer.unplug()


if __name__ == "__main__":
    main()
