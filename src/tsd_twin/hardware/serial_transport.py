"""Serial devices: exclusive ports, exchange of Dynamixel packets, and the I/O thread.

Only this module and `serial_ports` import pyserial.
"""

from __future__ import annotations

import fcntl
import logging
import termios
import threading
import time
from dataclasses import dataclass, replace
from typing import Any, Protocol, Self

import serial

from tsd_twin.errors import TwinError
from tsd_twin.hardware.dynamixel.packets import Decoder, Framing, StatusPacket, protocol2
from tsd_twin.hardware.link_health import LinkHealth
from tsd_twin.hardware.serial_ports import open_error, persistent_name
from tsd_twin.messages.sentences import sentence


class HardwareError(TwinError):
    """Raised if a device is missing, of another kind, or does not respond, or a port is gone."""


_LOG = logging.getLogger(__name__)
_WRITE_TIMEOUT_S = 0.1
"""Write timeout; without it, a write blocks until the other end reads."""

GONE = (serial.SerialException, OSError, termios.error, TypeError)
"""Exceptions that pyserial 3.5 raises if a device is unplugged: `read` and `write` the first,
`in_waiting` the second, `flush` and similar the third (not an OSError), and occasionally the last
(#328).
"""


def open_port(name: str, baud: int, timeout_s: float) -> Any:
    """Open a device, or a pyserial URL such as `socket://host:port`, for exclusive use.

    Returns a port of pyserial, which has no types.

    Raises:
        HardwareError: If the port cannot be opened; the message suggests a remedy.
    """
    try:
        port = serial.serial_for_url(
            name, baud, timeout=timeout_s, write_timeout=_WRITE_TIMEOUT_S, exclusive=True
        )
    except (*GONE, ValueError) as error:
        raise HardwareError(open_error(name, error)) from error
    _set_exclusive(port, termios.TIOCEXCL)
    try:
        port.set_low_latency_mode(True)
    except (*GONE, ValueError, AttributeError, NotImplementedError) as error:
        # Only FTDI chips support it; by default they wait 16 ms for further bytes.
        _LOG.debug("%s: no low latency mode: %s", name, error)
    return port


def close_port(port: Any) -> None:
    """Unlock and close a port, even if it is gone."""
    # A device that another program holds open, like the simulator, would stay locked.
    _set_exclusive(port, termios.TIOCNXCL)
    try:
        port.close()
    except GONE:
        return


def _set_exclusive(port: Any, request: int) -> None:
    """Lock the device against programs that ignore pyserial's lock, or unlock it.

    pyserial locks with `flock` only, which other programs may ignore. With TIOCEXCL the kernel
    refuses to open the device again, except for root.
    """
    try:
        fcntl.ioctl(port.fileno(), request)
    except (OSError, AttributeError, ValueError) as error:  # URLs have no local device.
        _LOG.debug("no exclusive mode: %s", error)


_READ_S = 0.002
"""Timeout of a single read, short enough to keep the timeout of a request."""
_CHUNK = 4096
_LONGEST_DRAIN = 5.0


@dataclass(frozen=True, slots=True)
class _Received:
    """Bytes received after a request, until the next."""

    data: bytes = b""
    packets: int = 0
    skipped: int = 0
    """Number of bytes outside packets that are not explained by an earlier response."""
    wrong_sums: int = 0
    rest: bytes = b""
    """Beginning of a packet."""
    has_fragments: bool = False
    """Whether there are bytes outside packets."""
    unknown: bool = False
    """Whether they belong to an earlier user of the port."""

    @classmethod
    def of(cls, framing: Framing, data: bytes) -> Self:
        decoder = Decoder(framing)
        packets = [each for each in decoder.feed(data, 0.0) if framing.as_status(each) is not None]
        fragments = bool(decoder.skipped or decoder.rest)
        return cls(data, len(packets), decoder.skipped, decoder.sum_errors, decoder.rest, fragments)


class SerialTransport:
    """Packet transport on an open port; not thread-safe, not even `close`."""

    def __init__(self, name: str, baud: int) -> None:
        """Open the port.

        Raises:
            HardwareError: If the port cannot be opened.
        """
        self.name = name
        self._port = open_port(name, baud, _READ_S)
        self._incomplete: _Received | None = _Received(unknown=True)
        """Bytes received after the last request, if responses were missing."""
        self.broken = 0
        """Number of corrupt responses."""
        self.late = 0
        """Number of responses that arrived after their request had timed out."""

    def request(
        self,
        request: bytes,
        answers: int,
        patience_s: float,
        framing: Framing = protocol2,
    ) -> list[StatusPacket]:
        """Send a request and return the responses; fewer than expected after the timeout.

        Raises:
            HardwareError: If the port is gone.
        """
        before, pending = self._incomplete, b""
        try:
            if before is not None and self._port.in_waiting:
                pending = self._port.read(self._port.in_waiting)
            self._port.write(request)
            found, heard = self._receive(Decoder(framing), answers, patience_s)
        except GONE as error:
            raise HardwareError(f"{self.name} is gone") from error
        now = _Received.of(framing, heard)
        if before is not None:
            both = _Received.of(framing, before.data + pending + heard)
            if both.packets > before.packets + len(found):
                self.late += 1  # Its rest has arrived: a program was delayed.
                now = replace(both, data=both.rest, packets=0)
            else:
                self.broken += not before.unknown and (before.has_fragments or bool(pending))
                now = replace(now, skipped=0)  # Bytes of that response.
        self._incomplete = None
        if len(found) == answers or now.wrong_sums:
            self.broken += bool(now.skipped or now.wrong_sums)
        else:
            self._incomplete = now
        return found

    def drain(self, silence_s: float) -> None:
        """Discard incoming bytes until the line is silent for `silence_s`, or a maximum time has
        passed.

        Raises:
            HardwareError: If the port is gone.
        """
        try:
            began_s = now_s = received_s = time.monotonic()
            while now_s - received_s < silence_s and now_s - began_s < _LONGEST_DRAIN * silence_s:
                heard = bool(self._port.read(_CHUNK))
                now_s = time.monotonic()
                received_s = now_s if heard else received_s
        except GONE as error:
            raise HardwareError(f"{self.name} is gone") from error

    def _receive(
        self, decoder: Decoder, answers: int, patience_s: float
    ) -> tuple[list[StatusPacket], bytes]:
        """Return the responses, and all bytes received."""
        found: list[StatusPacket] = []
        heard = b""
        end_s = time.monotonic() + patience_s
        while len(found) < answers:
            # Read only available bytes, or wait for the first; a larger read would wait for all.
            data = self._port.read(min(max(1, self._port.in_waiting), _CHUNK))
            heard += data
            now_s = time.monotonic()
            for packet in decoder.feed(data, now_s):
                answer = decoder.framing.as_status(packet)
                if answer is not None:
                    found.append(answer)
            if now_s > end_s:
                break
        return found, heard

    def close(self) -> None:
        """Close the port, even if it is gone."""
        close_port(self._port)


_IDLE_S = 0.02
"""Cycle period if the node requests no cycles."""
_RETRY_S = 0.25
_GIVE_UP_S = 2.0
"""Time without a response after which the port is reopened."""
_LEAVE_S = 2.0


class Device(Protocol):
    """Device on a serial port; called only by its `DeviceThread`."""

    baud: int
    health: LinkHealth

    def connect(self, transport: SerialTransport) -> None:
        """Identify and configure the device.

        Raises:
            HardwareError: If it is another device or does not respond.
        """
        ...

    def cycle(self, transport: SerialTransport) -> bool:
        """Exchange data once; return whether all responses arrived."""
        ...

    def disconnected(self) -> None:
        """Discard the report after a lost connection."""
        ...

    def rest(self, transport: SerialTransport) -> None:
        """Put the device into its rest state; called last."""
        ...


class DeviceLoop:
    """Exchanges with a device, one per step; reopens the port whenever the connection is lost.

    Not thread-safe. The caller steps when data is due, at latest after `pause_s`.
    """

    def __init__(self, port: str, device: Device) -> None:
        """Connect.

        Raises:
            HardwareError: If the device is missing, of another kind, or does not respond.
        """
        self._device = device
        self._port = persistent_name(port)
        self._transport: SerialTransport | None = self._connect()
        self._received_s = time.monotonic()
        self._logged: set[str] = set()
        self._connect_error = ""

    @property
    def connected(self) -> bool:
        """Whether the port is open and the device has been found."""
        return self._transport is not None

    @property
    def pause_s(self) -> float:
        """Longest pause before the next step, s; the exact pause while disconnected."""
        return _IDLE_S if self.connected else _RETRY_S

    def step(self) -> None:
        """Exchange data once; while disconnected, attempt to connect."""
        if self._transport is None:
            self._reconnect()
            return
        try:
            self._cycle(self._transport)
        except HardwareError as error:
            self._lose(self._transport, error)

    def close(self) -> None:
        """Put the device into its rest state and close the port."""
        transport = self._transport
        if transport is None:
            return
        try:
            self._device.rest(transport)
        except HardwareError as error:
            self._lose(transport, error)
        else:
            self._transport = None
            transport.close()

    def _cycle(self, transport: SerialTransport) -> None:
        health = self._device.health
        if self._device.cycle(transport):
            self._received_s = time.monotonic()
        elif time.monotonic() - self._received_s > _GIVE_UP_S:
            raise HardwareError(f"{health.name} has been silent for {_GIVE_UP_S:g} s")
        fault = health.connection_fault(self._received_s, time.monotonic())
        if fault is None:
            if self._logged:
                _LOG.warning("%s answers again, over a clean line", health.name)
            self._logged.clear()
        elif fault.code not in self._logged:  # A silence may turn out to be garbage.
            self._logged.add(fault.code)
            _LOG.warning("%s", sentence(fault))

    def _connect(self) -> SerialTransport:
        transport = SerialTransport(self._port, self._device.baud)
        try:
            self._device.connect(transport)
        except HardwareError:
            transport.close()
            raise
        self._device.health.disconnect_reason = ""
        return transport

    def _lose(self, transport: SerialTransport, error: HardwareError) -> None:
        _LOG.warning("%s", error)
        self._disconnected(error)
        self._transport, self._connect_error = None, ""
        transport.close()

    def _disconnected(self, error: HardwareError) -> None:
        self._device.health.add_disconnect(str(error))
        self._device.disconnected()

    def _reconnect(self) -> None:
        try:
            self._transport = self._connect()
        except HardwareError as error:
            self._disconnected(error)
            if str(error) != self._connect_error:
                _LOG.info("%s", error)
            self._connect_error = str(error)
        else:
            _LOG.warning("%s is back", self._device.health.name)
            self._received_s = time.monotonic()
            self._logged.clear()


class DeviceThread:
    """I/O thread of a `DeviceLoop`."""

    def __init__(self, port: str, device: Device) -> None:
        """Connect.

        Raises:
            HardwareError: If the device is missing, of another kind, or does not respond.
        """
        self._port, self._device = port, device
        self._stopping = threading.Event()
        self._cycle_requested = threading.Event()
        self._first_attempt = threading.Event()
        self._connect_error: HardwareError | None = None
        self._thread = threading.Thread(target=self._run, name=device.health.name, daemon=True)
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
            loop = DeviceLoop(self._port, self._device)
        except HardwareError as error:
            self._connect_error = error
            return
        finally:
            self._first_attempt.set()
        while not self._stopping.is_set():
            if loop.connected:
                self._cycle_requested.wait(loop.pause_s)
                self._cycle_requested.clear()
            elif self._stopping.wait(loop.pause_s):
                return
            loop.step()
        loop.close()
