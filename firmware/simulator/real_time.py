# SPDX-License-Identifier: GPL-3.0-or-later
"""Simulated robot in real time behind a pseudo-terminal, which acts as its serial port."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import math
import os
import select
import termios
import time
import tty
from pathlib import Path

from firmware.simulator.simulation import FirmwareSimulation

_SLICE_S = 0.0005
"""Bytes wait this long at most until the board gets them."""
_AT_ONCE = 10
"""Slices that are caught up with before it listens again."""
_OPENED_S = 1.0
"""A line on which no byte came for this long is taken for one that is opened anew."""
_START_S = 0.01
"""Time after which the firmware receives."""
_BEHIND_S = 0.05
"""Longest delay that is caught up; after a longer one the robot's time pauses meanwhile."""


class RealTimeSimulation:
    """Simulation in real time, its host line at `path`; `step` must be called continuously."""

    def __init__(self, simulation: FirmwareSimulation, link: Path | None = None) -> None:
        self.simulation = simulation
        self._link = link
        self._ends: tuple[int, int] | None = None
        self._frozen_until_s = 0.0
        self._unplugged_until_s = 0.0
        self._heard_s = -math.inf
        self._locked = False
        simulation.run(_START_S)
        self._due_s = time.monotonic()
        self._plug_in()

    @property
    def path(self) -> str:
        """What a program has to open; changes when it is unplugged, the link does not."""
        return str(self._link) if self._link else os.ttyname(self._need_ends()[1])

    def close(self) -> None:
        """Remove the port and free the simulation."""
        self.unplug(0.0)
        self.simulation.close()

    def unplug(self, seconds: float) -> None:
        """Remove the port for a while."""
        self._unplugged_until_s = time.monotonic() + seconds
        if self._link:
            self._link.unlink(missing_ok=True)
        for end in self._ends or ():
            os.close(end)
        self._ends = None
        self.simulation.set_usb(plugged=False)

    def freeze(self, seconds: float) -> None:
        """Let the board stand still for a while, its watchdog and its pulses with it."""
        self._frozen_until_s = time.monotonic() + seconds

    def garbage(self, data: bytes) -> None:
        """Put bytes on the line to the PC that no board sent."""
        if self._ends:
            os.write(self._ends[0], data)

    def step(self, also: int | None = None) -> bool:
        """Go on for a moment of real time; return whether there is something to read at `also`."""
        now_s = time.monotonic()
        if self._ends is None and now_s >= self._unplugged_until_s:
            self._plug_in()
        if now_s - self._heard_s > _OPENED_S:
            self._unlock()
        frozen = now_s < self._frozen_until_s
        if frozen or now_s - self._due_s > _BEHIND_S:
            self._due_s = now_s
        watched = [also] if also is not None else []
        if self._ends and not frozen:
            watched.append(self._ends[0])
        wait_s = max(0.0, self._due_s - now_s) if not frozen else 0.01
        ready, _, _ = select.select(watched, [], [], wait_s)
        if self._ends and self._ends[0] in ready:
            self._forward(self._ends[0])
        if not frozen:
            self._catch_up()
        return also in ready

    def _catch_up(self) -> None:
        # Bounded: a computer too busy to keep up still has to read the port.
        for _ in range(_AT_ONCE):
            if self._due_s > time.monotonic():
                return
            self._due_s += _SLICE_S
            self.simulation.run(_SLICE_S)
            data = self.simulation.board.receive()
            if data and self._ends:
                # A program that does not read loses bytes, as at a real port.
                with contextlib.suppress(BlockingIOError):
                    os.write(self._ends[0], data)

    def _forward(self, master: int) -> None:
        try:
            data = os.read(master, 4096)
            now_s = time.monotonic()
            # That a program opens a pty cannot be seen; it is taken for opened with the first byte.
            if now_s - self._heard_s > _OPENED_S:
                self.simulation.open_port()
            self._heard_s = now_s
            self._locked = True
            self.simulation.board.send(data)
        except OSError as error:
            if error.errno not in (errno.EIO, errno.EAGAIN):
                raise

    def _unlock(self) -> None:
        """Undo TIOCEXCL of a program that was killed: its last close would do it on a real port."""
        if not self._ends or not self._locked:
            return
        with contextlib.suppress(BlockingIOError):  # Another program has the port.
            fcntl.flock(self._ends[1], fcntl.LOCK_EX | fcntl.LOCK_NB)
            fcntl.ioctl(self._ends[1], termios.TIOCNXCL)
            fcntl.flock(self._ends[1], fcntl.LOCK_UN)
            self._locked = False

    def _plug_in(self) -> None:
        # The other end stays open here too: it would be gone when a program closes it.
        master, slave = os.openpty()
        tty.setraw(slave)
        os.set_blocking(master, False)
        self._ends = (master, slave)
        self.simulation.set_usb(plugged=True)
        if self._link:
            self._link.unlink(missing_ok=True)
            self._link.symlink_to(os.ttyname(slave))

    def _need_ends(self) -> tuple[int, int]:
        if self._ends is None:
            raise OSError("unplugged")
        return self._ends
