"""I/O thread of a serial device: connects, exchanges data in each cycle, and reconnects after
errors.
"""

from __future__ import annotations

import logging
import threading
import time
from typing import Protocol

from tsd_twin.hardware.serial_transport import (
    HardwareError,
    LinkHealth,
    SerialTransport,
    persistent_name,
)

_LOG = logging.getLogger(__name__)
_IDLE_S = 0.02
"""Period of the cycles when the node requests none."""
_RETRY_S = 0.25
_GIVE_UP_S = 2.0
"""Time without a response after which the port is opened again."""
_LEAVE_S = 2.0
SILENT_S = 0.1
"""Maximum age of a report."""


def silence_fault(name: str) -> str:
    """Return the fault message for a device that has stopped responding."""
    return f"{name} has not answered for {SILENT_S * 1000:.0f} ms"


class Device(Protocol):
    """Device on a serial port, as `DeviceThread` uses it; only that thread calls it."""

    name: str
    baud: int
    health: LinkHealth

    def connect(self, line: SerialTransport) -> None:
        """Identify and configure the device.

        Raises:
            HardwareError: it is another device, or does not answer.
        """
        ...

    def cycle(self, line: SerialTransport) -> bool:
        """Exchange data once; return whether all responses came."""
        ...

    def lose(self, reason: str) -> None:
        """Record that the connection is lost, and why."""
        ...

    def leave(self, line: SerialTransport) -> None:
        """Put the device into its rest state; the last call."""
        ...


class DeviceThread:
    """I/O thread of one device; opens the port again whenever the connection is lost."""

    def __init__(self, port: str, device: Device) -> None:
        """Connect.

        Raises:
            HardwareError: the device is not there, not ours, or does not answer.
        """
        self._device = device
        self._port = persistent_name(port)
        self._stopping = threading.Event()
        self._wanted = threading.Event()
        self._decided = threading.Event()
        self._refused: HardwareError | None = None
        self._thread = threading.Thread(target=self._run, name=device.name, daemon=True)
        self._thread.start()
        self._decided.wait()
        if self._refused is not None:
            raise self._refused

    def cycle(self) -> None:
        """Request a cycle now, without waiting for it."""
        self._wanted.set()

    def close(self) -> None:
        """Put the device into its rest state and close the port."""
        self._stopping.set()
        self._wanted.set()
        self._thread.join(_LEAVE_S)

    def _run(self) -> None:
        try:
            line = self._connect()
        except HardwareError as error:
            self._refused = error
            return
        finally:
            self._decided.set()
        while line is not None:
            try:
                self._serve(line)
                self._device.leave(line)
                line.close()
                return
            except HardwareError as error:
                _LOG.warning("%s", error)
                self._device.lose(str(error))
            line.close()
            line = self._reconnect()

    def _serve(self, line: SerialTransport) -> None:
        heard_s = time.monotonic()
        told = ""
        while not self._stopping.is_set():
            self._wanted.wait(_IDLE_S)
            self._wanted.clear()
            if self._device.cycle(line):
                heard_s = time.monotonic()
            elif time.monotonic() - heard_s > _GIVE_UP_S:
                raise HardwareError(f"{self._device.name} has been silent for {_GIVE_UP_S:g} s")
            told = self._tell(told, time.monotonic() - heard_s)

    def _tell(self, told: str, silent_s: float) -> str:
        """Log when communication fails and when it recovers; return the message that now holds."""
        noise = self._device.health.noise
        trouble = noise.fault
        if silent_s > SILENT_S:
            trouble = noise.suspicion or silence_fault(self._device.name)
        if bool(trouble) != bool(told):
            _LOG.warning("%s", trouble or f"{self._device.name} answers again, over a clean line")
        return trouble

    def _connect(self) -> SerialTransport:
        line = SerialTransport(self._port, self._device.baud)
        try:
            self._device.connect(line)
        except HardwareError:
            line.close()
            raise
        return line

    def _reconnect(self) -> SerialTransport | None:
        told = ""
        while not self._stopping.wait(_RETRY_S):
            try:
                line = self._connect()
            except HardwareError as error:
                self._device.lose(str(error))
                if str(error) != told:
                    _LOG.info("%s", error)
                told = str(error)
            else:
                _LOG.warning("%s is back", self._device.name)
                return line
        return None
