"""Old name of `tsd_twin.cli.program`, kept for one release."""

from __future__ import annotations

from tsd_twin.cli.program import (
    add_adapter_flags as add_adapter_flags,
)
from tsd_twin.cli.program import (
    add_client_flags as add_client_flags,
)
from tsd_twin.cli.program import (
    add_errors_flag as add_errors_flag,
)
from tsd_twin.cli.program import (
    add_node_flags as add_node_flags,
)
from tsd_twin.cli.program import (
    add_plant_flag as add_plant_flag,
)
from tsd_twin.cli.program import (
    add_robot_flags as add_robot_flags,
)
from tsd_twin.cli.program import (
    certificate as certificate,
)
from tsd_twin.cli.program import (
    client_bus as client_bus,
)
from tsd_twin.cli.program import (
    node_bus as node_bus,
)
from tsd_twin.cli.program import (
    parser as parser,
)
from tsd_twin.cli.program import (
    run as run,
)
from tsd_twin.cli.program import (
    say_ready as say_ready,
)
from tsd_twin.cli.program import (
    stop_event as stop_event,
)
