"""Serial ports of this machine: their names, USB chips, and why one cannot be opened."""

from __future__ import annotations

import errno
from pathlib import Path

from serial.tools import list_ports

_BY_ID = Path("/dev/serial/by-id")


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


def open_error(name: str, error: BaseException) -> str:
    """Return why a port cannot be opened, and a remedy."""
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
