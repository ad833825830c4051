"""Opening ports: names that last, and one sentence for each thing that can be wrong."""

from __future__ import annotations

import errno
import fcntl
import os
import pty
import socket
import sys
from collections.abc import Generator
from pathlib import Path

import pytest
import serial
from serial.tools import list_ports_common

from tsd_twin.hardware.serial_ports import chip_warning, open_error, persistent_name
from tsd_twin.hardware.serial_transport import HardwareError, close_port, open_port

TIOCGEXCL = 0x80045440
"""Linux: whether a terminal is locked with TIOCEXCL."""


@pytest.fixture
def terminal() -> Generator[tuple[int, str]]:
    master, slave = pty.openpty()
    yield master, os.ttyname(slave)
    os.close(slave)
    os.close(master)


def refusal(name: str) -> str:
    with pytest.raises(HardwareError) as caught:
        open_port(name, 115200, 0.01)
    return str(caught.value)


def test_a_port_carries_bytes_both_ways(terminal: tuple[int, str]) -> None:
    master, name = terminal
    port = open_port(name, 1_000_000, 1.0)
    port.write(b"\x00\xffout")
    assert os.read(master, 5) == b"\x00\xffout"
    os.write(master, b"\r\n\x03in")
    assert port.read(5) == b"\r\n\x03in"
    port.close()


def test_a_device_that_is_not_there(tmp_path: Path) -> None:
    assert refusal(str(tmp_path / "ttyACM9")).endswith(
        "is not there: plug it in, or choose one that 'tsd-bridge --list' shows"
    )


def test_a_file_is_no_port(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    assert refusal(str(tmp_path / "file")).endswith("is no serial port")


def test_a_port_in_use(terminal: tuple[int, str]) -> None:
    name = terminal[1]
    port = open_port(name, 115200, 0.01)
    assert refusal(name) == f"{name} is in use by another program: end it first"
    close_port(port)
    close_port(open_port(name, 115200, 0.01))


@pytest.mark.parametrize(
    ("vid", "pid", "baud", "named"),
    [
        (0x2341, 0x0042, 1_000_000, "ATmega16U2"),
        (0x1A86, 0x7523, 500_000, "CH340"),
        (0x2341, 0x0042, 115_200, ""),
        (0x0403, 0x6001, 1_000_000, ""),
        (None, None, 1_000_000, ""),
    ],
)
def test_a_usb_chip_that_corrupts_bytes_at_this_rate_is_named(
    vid: int | None,
    pid: int | None,
    baud: int,
    named: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    port = list_ports_common.ListPortInfo(str(tmp_path / "ttyACM0"))
    port.vid, port.pid = vid, pid
    monkeypatch.setattr("serial.tools.list_ports.comports", lambda: [port])
    (tmp_path / "by-id").symlink_to(tmp_path / "ttyACM0")
    warning = chip_warning(str(tmp_path / "by-id"), baud)
    assert bool(warning) == bool(named)
    assert named in warning
    assert chip_warning(str(tmp_path / "ttyS0"), baud) == ""


def test_a_port_in_use_is_locked_for_programs_without_locks_too(terminal: tuple[int, str]) -> None:
    """The kernel refuses to open it, except for root, for whom only the lock can be seen."""
    slave = os.open(terminal[1], os.O_RDWR | os.O_NOCTTY)

    def locked() -> bool:
        return bool(int.from_bytes(fcntl.ioctl(slave, TIOCGEXCL, bytes(4)), sys.byteorder))

    assert not locked()
    port = open_port(terminal[1], 115200, 0.01)
    assert locked()
    if os.geteuid() != 0:
        with pytest.raises(OSError, match="busy"):
            os.open(terminal[1], os.O_RDWR | os.O_NOCTTY)
    close_port(port)
    assert not locked()
    os.close(slave)


def test_a_port_that_another_kind_of_program_has_locked(terminal: tuple[int, str]) -> None:
    with open(terminal[1], "rb+", buffering=0) as other:  # noqa: PTH123
        fcntl.flock(other, fcntl.LOCK_EX)
        assert "in use" in refusal(terminal[1])


def test_without_permission_it_says_what_group_to_join() -> None:
    """Root, as which tests may run, is refused nothing: so by the number that the system gives."""
    try:
        raise serial.SerialException(errno.EACCES, "could not open port x: Permission denied")
    except serial.SerialException as error:
        sentence = open_error("/dev/ttyACM0", error)
    assert "no permission to open /dev/ttyACM0" in sentence
    assert "dialout" in sentence


def test_nobody_at_an_address() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))  # Bound, but not listened on.
        url = f"socket://127.0.0.1:{taken.getsockname()[1]}"
        assert refusal(url) == f"no device answers at {url}"


def test_a_url_of_an_unknown_kind() -> None:
    assert "'foo' not known" in refusal("foo://bar")


def test_a_device_is_known_by_its_link(tmp_path: Path) -> None:
    links = tmp_path / "by-id"
    device = tmp_path / "ttyACM0"
    device.write_text("")
    assert persistent_name(str(device), links) == str(device)
    links.mkdir()
    assert persistent_name(str(device), links) == str(device)
    (links / "usb-Arduino_Mega_1234-if00").symlink_to("../ttyACM0")
    (links / "usb-Other").symlink_to("../ttyACM1")
    link = str(links / "usb-Arduino_Mega_1234-if00")
    assert persistent_name(str(device), links) == link
    assert persistent_name(link, links) == link
    assert persistent_name("socket://host:1", links) == "socket://host:1"
