"""A bad link between two programs: delay, jitter, loss, reordering, stalls, little bandwidth."""

from tsd_twin.linksim.counters import Counters
from tsd_twin.linksim.errors import LinkError
from tsd_twin.linksim.simulator import LinkSimulator, Way
from tsd_twin.linksim.spec import LinkSpec, Stall

__all__ = ["Counters", "LinkError", "LinkSimulator", "LinkSpec", "Stall", "Way"]
