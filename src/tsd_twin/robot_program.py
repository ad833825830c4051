"""Old name of `tsd_twin.cli.node_program`, kept for one release."""

from __future__ import annotations

from tsd_twin.cli.node_program import *  # noqa: F403
