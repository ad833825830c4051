"""Serial ports: opening them, naming them, and what pyserial raises when one is gone."""

from __future__ import annotations

import errno
import logging
import termios
from pathlib import Path
from typing import Any, Protocol

import serial
from serial.tools import list_ports

from tsd_twin.hardware.errors import PortError

_LOG = logging.getLogger(__name__)
_BY_ID = Path("/dev/serial/by-id")
_WRITE_TIMEOUT_S = 0.1
"""Without one, a write to somebody who does not read blocks for ever."""

GONE = (serial.SerialException, OSError, termios.error, TypeError)
"""What pyserial 3.5 raises when a device is unplugged: `read` and `write` the first, `in_waiting`
the second, `flush` and the like the third, which is no OSError, and now and then the last (#328).
"""


class Port(Protocol):
    """What we use of an open port of pyserial, whatever its kind."""

    @property
    def in_waiting(self) -> int:
        """Bytes that can be read at once."""
        ...

    def read(self, size: int) -> bytes:
        """Return what comes, at most `size`; fewer when the time-out has run out."""
        ...

    def write(self, data: bytes) -> int | None:
        """Send."""
        ...

    def reset_input_buffer(self) -> None:
        """Forget what has come."""
        ...

    def close(self) -> None:
        """Close."""
        ...


def open_port(name: str, baud: int, timeout_s: float) -> Port:
    """Open a device, or a URL of pyserial such as `socket://host:port`, for us alone.

    Raises:
        PortError: it cannot be opened; the text says what to do.
    """
    try:
        port: Any = serial.serial_for_url(
            name, baud, timeout=timeout_s, write_timeout=_WRITE_TIMEOUT_S, exclusive=True
        )
    except (*GONE, ValueError) as error:
        raise PortError(_sentence(name, error)) from error
    try:
        port.set_low_latency_mode(True)
    except (*GONE, ValueError, AttributeError, NotImplementedError) as error:
        # Only FTDI chips know it; they wait 16 ms for more to send without.
        _LOG.debug("%s: no low latency mode: %s", name, error)
    return port


def lasting_name(name: str, links: Path = _BY_ID) -> str:
    """Return a name that stays with the device: its link in /dev/serial/by-id if there is one.

    A device that is plugged in again may be ttyACM1 where it was ttyACM0.
    """
    if "://" in name or not links.is_dir():
        return name
    device = Path(name).resolve()
    for link in sorted(links.iterdir()):
        if link.resolve() == device:
            return str(link)
    return name


def ports() -> list[str]:
    """Return one line for each serial port there is: the name to use, and what it says it is."""
    try:
        found = sorted(list_ports.comports())
    except TypeError:  # A device that vanishes during the scan: pyserial #774.
        found = sorted(list_ports.comports())
    return [f"{lasting_name(port.device)}  {port.device}: {port.description}" for port in found]


def _sentence(name: str, error: BaseException) -> str:
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
            return f"nobody answers at {name}"
        case _:
            return f"{name} cannot be opened: {error}"


def _number(error: BaseException | None) -> int | None:
    """Return the errno of an error, or of the one that it was raised for; pyserial drops some."""
    while error is not None:
        number = getattr(error, "errno", None) or next(iter(error.args), None)
        if isinstance(number, int):
            return number
        error = error.__cause__ or error.__context__
    return None
