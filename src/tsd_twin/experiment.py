"""Old name of `tsd_twin.cli.experiment`, kept for one release."""

from __future__ import annotations

from tsd_twin.cli.experiment import *  # noqa: F403
