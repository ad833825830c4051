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


class Device(Protocol):
    """Device on a serial port, as `DeviceThread` uses it; only that thread calls it."""

    name: str
    baud: int
    health: LinkHealth
    disconnect_reason: str
    """Reason of a lost connection; else empty."""

    def connect(self, transport: SerialTransport) -> None:
        """Identify and configure the device.

        Raises:
            HardwareError: it is another device, or does not answer.
        """
        ...

    def cycle(self, transport: SerialTransport) -> bool:
        """Exchange data once; return whether all responses came."""
        ...

    def disconnected(self, reason: str) -> None:
        """Record that the connection is lost, and why."""
        ...

    def rest(self, transport: SerialTransport) -> None:
        """Put the device into its rest state; the last call."""
        ...


def connection_fault(device: Device, reported_s: float | None, now_s: float) -> str:
    """Fault of the connection to a device; empty while its reports are recent and its line clean.

    `reported_s` is the time of its newest report, None while it is not connected.
    """
    if reported_s is None:
        return f"{device.name} is not connected: {device.disconnect_reason}"
    errors = device.health.packet_errors
    if errors.fault or now_s - reported_s <= SILENT_S:
        return errors.fault
    return errors.suspicion or f"{device.name} has not answered for {SILENT_S * 1000:.0f} ms"


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
        self._cycle_requested = threading.Event()
        self._first_attempt = threading.Event()
        self._connect_error: HardwareError | None = None
        self._thread = threading.Thread(target=self._run, name=device.name, daemon=True)
        self._thread.start()
        self._first_attempt.wait()
        if self._connect_error is not None:
            raise self._connect_error

    def cycle(self) -> None:
        """Request a cycle now, without waiting for it."""
        self._cycle_requested.set()

    def close(self) -> None:
        """Put the device into its rest state and close the port."""
        self._stopping.set()
        self._cycle_requested.set()
        self._thread.join(_LEAVE_S)

    def _run(self) -> None:
        try:
            transport = self._connect()
        except HardwareError as error:
            self._connect_error = error
            return
        finally:
            self._first_attempt.set()
        while transport is not None:
            try:
                self._run_cycles(transport)
                self._device.rest(transport)
                transport.close()
                return
            except HardwareError as error:
                _LOG.warning("%s", error)
                self._device.disconnected(str(error))
            transport.close()
            transport = self._reconnect()

    def _run_cycles(self, transport: SerialTransport) -> None:
        heard_s = time.monotonic()
        logged = ""
        while not self._stopping.is_set():
            self._cycle_requested.wait(_IDLE_S)
            self._cycle_requested.clear()
            if self._device.cycle(transport):
                heard_s = time.monotonic()
            elif time.monotonic() - heard_s > _GIVE_UP_S:
                raise HardwareError(f"{self._device.name} has been silent for {_GIVE_UP_S:g} s")
            fault = connection_fault(self._device, heard_s, time.monotonic())
            if bool(fault) != bool(logged):
                _LOG.warning("%s", fault or f"{self._device.name} answers again, over a clean line")
            logged = fault

    def _connect(self) -> SerialTransport:
        transport = SerialTransport(self._port, self._device.baud)
        try:
            self._device.connect(transport)
        except HardwareError:
            transport.close()
            raise
        return transport

    def _reconnect(self) -> SerialTransport | None:
        logged = ""
        while not self._stopping.wait(_RETRY_S):
            try:
                transport = self._connect()
            except HardwareError as error:
                self._device.disconnected(str(error))
                if str(error) != logged:
                    _LOG.info("%s", error)
                logged = str(error)
            else:
                _LOG.warning("%s is back", self._device.name)
                return transport
        return None
