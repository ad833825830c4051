"""Old name of `tsd_twin.cli.program`, kept for one release."""

from __future__ import annotations

from tsd_twin.cli.program import *  # noqa: F403
