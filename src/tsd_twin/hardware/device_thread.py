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
"""A cycle is run this often when nobody asks for one."""
_RETRY_S = 0.25
_GIVE_UP_S = 2.0
"""A device that is silent for this long is opened anew."""
_LEAVE_S = 2.0
SILENT_S = 0.1
"""News older than this is none."""


def silence_fault(name: str) -> str:
    """Return the words for a device without news."""
    return f"{name} has not answered for {SILENT_S * 1000:.0f} ms"


class Device(Protocol):
    """What is at the other end; all calls come from the keeper's thread."""

    name: str
    baud: int
    health: LinkHealth

    def connect(self, line: SerialTransport) -> None:
        """See whether it is ours, and set it up.

        Raises:
            HardwareError: it is not, or does not answer.
        """
        ...

    def cycle(self, line: SerialTransport) -> bool:
        """Ask once; return whether all answers came."""
        ...

    def lose(self, reason: str) -> None:
        """Take note that the device is gone."""
        ...

    def leave(self, line: SerialTransport) -> None:
        """Leave it at rest; the last call."""
        ...


class DeviceThread:
    """Keeps one device: one thread, one port, which is opened again whenever it is lost."""

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
        """Ask for a cycle now; what is under way is not waited for."""
        self._wanted.set()

    def close(self) -> None:
        """Leave the device at rest and close the port."""
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
        """Warn when the line begins to be of no use, and when that ends; return what was told."""
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
