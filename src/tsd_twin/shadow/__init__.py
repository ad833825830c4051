"""Comparison of a robot with a simulation on the same set-points, the shadow twin."""

from tsd_twin.shadow.drift_tests import Drift
from tsd_twin.shadow.feed import STREAMS, ShadowFeed
from tsd_twin.shadow.twin import ShadowReport, ShadowTwin

__all__ = ["STREAMS", "Drift", "ShadowFeed", "ShadowReport", "ShadowTwin"]
