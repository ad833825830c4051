"""Priorities of processes under test, where the run of all tests asks for real time."""

from __future__ import annotations

import os

REALTIME = os.environ.get("TEST_REALTIME", "").split()
"""Starts a command in real time, as that of a robot on a machine of its own."""
AS_OTHERS = ["chrt", "--other", "0"] if REALTIME else []
"""Starts a command like those of others: tests in real time would pass their priority on, and what
only computes would hold up robots."""
