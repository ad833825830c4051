"""Hardware interface of robots, and drivers on serial ports; the only package with pyserial.

It imports no driver, so that `robot_io` costs no pyserial.
"""

from __future__ import annotations
