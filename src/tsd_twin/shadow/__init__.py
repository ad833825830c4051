"""Shadow twin: comparison of a robot with a simulation driven by the same setpoints."""

from tsd_twin.shadow.fault_detectors import Drift, ShadowReport
from tsd_twin.shadow.twin import STREAMS, ShadowFeed, ShadowTwin

__all__ = ["STREAMS", "Drift", "ShadowFeed", "ShadowReport", "ShadowTwin"]
