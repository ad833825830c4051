"""Motion planning and limits: paths, time-optimal trajectories, tracking, twist limiter.

Exports only the limiter, which the control loop needs. Import paths, timing and tracking from their
modules.
"""

from __future__ import annotations

from tsd_twin.motion.twist_limiter import TwistLimiter, clip_to_finite

__all__ = ["TwistLimiter", "clip_to_finite"]
