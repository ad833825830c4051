"""Serial devices: ports, exchange of Dynamixel packets, error rate, and the I/O thread.

The only module that imports pyserial.
"""

from __future__ import annotations

import errno
import fcntl
import logging
import math
import termios
import threading
import time
from collections import deque
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol, Self

import serial
from serial.tools import list_ports

from tsd_twin.errors import TwinError
from tsd_twin.hardware.dynamixel.packets import Decoder, Framing, StatusPacket, protocol2
from tsd_twin.messages.codes import Code, Reason, Type, because
from tsd_twin.messages.sentences import WORDS, sentence


class HardwareError(TwinError):
    """Raised if a device is missing, of another kind, or does not respond, or a port is gone."""


WINDOW_S = 0.5
LIMIT = 5
"""Corrupt cycles within the window at which the line is faulty.

The fault clears when the window has none. The limit is 5 of 50 cycles at 100 Hz: a poor line with
one corrupt cycle in 1000 reaches it by chance once in years. It is low because one corrupt packet
in 65,536 passes the checksum.
"""
_REMEMBERED = 500
SILENT_S = 0.1
"""Maximum age of a report."""


class LinkHealth:
    """Connection to a device on a serial line: round trips, missed responses and packet errors.

    Updated by the I/O thread only. Reasons are replaced as a whole, and any thread may read them.
    """

    def __init__(self, device: str) -> None:
        """`device` is the word for the device in reasons."""
        self.name = WORDS[Type.DEVICE][device]
        self.corrupt = 0
        """Total cycles with a corrupt packet."""
        self.suspicion: Reason | None = None
        """Two or more recent corrupt packets, a likely cause of missing responses, or None."""
        self.packet_fault: Reason | None = None
        """Fault while the error rate is above the limit, or None."""
        self.disconnect_reason = ""
        """Reason of a lost connection, or ""."""
        self._device = device
        self._corrupt_s: list[float] = []
        self._trips_ms: deque[float] = deque(maxlen=_REMEMBERED)
        self._cycles = self._missed = self._reconnects = 0

    def add_round_trip(self, trip_s: float) -> None:
        """Record a cycle with a complete response after `trip_s`."""
        self._cycles += 1
        self._trips_ms.append(1000.0 * trip_s)

    def add_timeout(self) -> None:
        """Record a cycle without a complete response."""
        self._cycles += 1
        self._missed += 1

    def add_packets(self, corrupt: bool, now_s: float) -> None:
        """Record whether a cycle contained a corrupt packet."""
        self._corrupt_s = [at_s for at_s in self._corrupt_s if now_s - at_s < WINDOW_S]
        if corrupt:
            self.corrupt += 1
            self._corrupt_s.append(now_s)
        count = len(self._corrupt_s)
        if not count:
            self.suspicion = self.packet_fault = None
            return
        lately_s = now_s - self._corrupt_s[0]
        if count > 1:
            self.suspicion = because(Code.LINE_GARBAGE, line=self._device, count=count, s=lately_s)
        if count >= LIMIT and self.packet_fault is None:
            self.packet_fault = self.suspicion

    def add_disconnect(self, reason: str) -> None:
        """Record a lost connection, or a failed attempt to connect again."""
        self.disconnect_reason = reason
        self._reconnects += 1

    def connection_fault(self, reported_s: float | None, now_s: float) -> Reason | None:
        """Return the connection fault, or None while reports are recent and the line is clean.

        `reported_s` is the time of the latest report, or None if not connected.
        """
        if reported_s is None:
            text = self.disconnect_reason
            return because(Code.DEVICE_DISCONNECTED, device=self._device, text=text)
        if self.packet_fault is not None or now_s - reported_s <= SILENT_S:
            return self.packet_fault
        silent = because(Code.DEVICE_SILENT, device=self._device, ms=1000.0 * SILENT_S)
        return self.suspicion or silent

    def status(self) -> dict[str, object]:
        """Return statistics for the status; round trips in milliseconds."""
        # Copy first, because another thread may append.
        trips = sorted(self._trips_ms.copy())
        figures: dict[str, object] = {"cycles": self._cycles, "missed": self._missed}
        figures["broken"] = self.corrupt
        figures["reconnects"] = self._reconnects
        if trips:
            figures["round_trip_ms"] = round(trips[len(trips) // 2], 2)
            figures["round_trip_p99_ms"] = round(trips[math.ceil(0.99 * len(trips)) - 1], 2)
        return figures


_LOG = logging.getLogger(__name__)
_BY_ID = Path("/dev/serial/by-id")
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
        raise HardwareError(_open_error(name, error)) from error
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


def persistent_name(name: str, links: Path = _BY_ID) -> str:
    """Return a persistent name: the device's link in /dev/serial/by-id, if it exists.

    After reconnecting, a device may be ttyACM1 instead of ttyACM0.
    """
    if "://" in name or not links.is_dir():
        return name
    device = Path(name).resolve()
    for link in sorted(links.iterdir()):
        if link.resolve() == device:
            return str(link)
    return name


def serial_ports() -> list[str]:
    """Return one line per serial port: its persistent name and its description."""
    try:
        found = sorted(list_ports.comports())
    except TypeError:  # A device vanished during the scan: pyserial #774.
        found = sorted(list_ports.comports())
    return [f"{persistent_name(port.device)}  {port.device}: {port.description}" for port in found]


_SLOW_CHIPS = {
    (0x2341, 0x0010): "ATmega16U2",
    (0x2341, 0x0042): "ATmega16U2",
    (0x2A03, 0x0042): "ATmega16U2",
    (0x1A86, 0x7523): "CH340",
}
"""USB chips of the Mega and its clones, by vendor and product id."""
_SAFE_BAUD = 115_200


def chip_warning(name: str, baud: int) -> str:
    """Return a warning if the port's USB chip is known to corrupt bytes at this rate, or ""."""
    if baud <= _SAFE_BAUD or "://" in name:
        return ""
    device = str(Path(name).resolve())
    for port in list_ports.comports():
        chip = _SLOW_CHIPS.get((port.vid, port.pid))
        if chip and str(Path(port.device).resolve()) == device:
            return (
                f"the USB chip at {name} is of type {chip}, which corrupts bytes at {baud} Bd: "
                "use an adapter with an FTDI chip"
            )
    return ""


def _open_error(name: str, error: BaseException) -> str:
    match _number(error):
        case errno.ENOENT:
            return f"{name} is not there: plug it in, or choose one that 'tsd-bridge --list' shows"
        case errno.EACCES | errno.EPERM:
            return (
                f"no permission to open {name}: join the group dialout "
                "('sudo usermod -aG dialout $USER'), and log in again"
            )
        case errno.EBUSY | errno.EAGAIN:
            return f"{name} is in use by another program: end it first"
        case errno.ENOTTY | errno.EISDIR | errno.EINVAL:
            return f"{name} is no serial port"
        case errno.ECONNREFUSED | errno.EHOSTUNREACH | errno.ETIMEDOUT:
            return f"no device answers at {name}"
        case _:
            return f"{name} cannot be opened: {error}"


def _number(error: BaseException | None) -> int | None:
    """Return the errno of an error or of its cause; pyserial drops some."""
    while error is not None:
        number = getattr(error, "errno", None) or next(iter(error.args), None)
        if isinstance(number, int):
            return number
        error = error.__cause__ or error.__context__
    return None


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
        """What came after the last request, if responses were missing."""
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


class DeviceThread:
    """I/O thread of a device; reopens the port whenever the connection is lost."""

    def __init__(self, port: str, device: Device) -> None:
        """Connect.

        Raises:
            HardwareError: If the device is missing, of another kind, or does not respond.
        """
        self._device = device
        self._port = persistent_name(port)
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
                self._disconnected(error)
            transport.close()
            transport = self._reconnect()

    def _run_cycles(self, transport: SerialTransport) -> None:
        received_s = time.monotonic()
        health = self._device.health
        logged: set[str] = set()
        while not self._stopping.is_set():
            self._cycle_requested.wait(_IDLE_S)
            self._cycle_requested.clear()
            if self._device.cycle(transport):
                received_s = time.monotonic()
            elif time.monotonic() - received_s > _GIVE_UP_S:
                raise HardwareError(f"{health.name} has been silent for {_GIVE_UP_S:g} s")
            fault = health.connection_fault(received_s, time.monotonic())
            if fault is None:
                if logged:
                    _LOG.warning("%s answers again, over a clean line", health.name)
                logged.clear()
            elif fault.code not in logged:  # A silence may turn out to be garbage.
                logged.add(fault.code)
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

    def _disconnected(self, error: HardwareError) -> None:
        self._device.health.add_disconnect(str(error))
        self._device.disconnected()

    def _reconnect(self) -> SerialTransport | None:
        logged = ""
        while not self._stopping.wait(_RETRY_S):
            try:
                transport = self._connect()
            except HardwareError as error:
                self._disconnected(error)
                if str(error) != logged:
                    _LOG.info("%s", error)
                logged = str(error)
            else:
                _LOG.warning("%s is back", self._device.health.name)
                return transport
        return None
