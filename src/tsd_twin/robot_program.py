"""Old name of `tsd_twin.cli.node_program`, kept for one release."""

from __future__ import annotations

from tsd_twin.cli.node_program import (
    Companion as Companion,
)
from tsd_twin.cli.node_program import (
    Flags as Flags,
)
from tsd_twin.cli.node_program import (
    Pose as Pose,
)
from tsd_twin.cli.node_program import (
    serve as serve,
)
