"""Motion planning and limits: paths, time-optimal trajectories, tracking, twist limiter.

The control loop needs the limiter only. Paths, timing and tracking are imported from their modules.
"""

from __future__ import annotations

from tsd_twin.motion.prediction import TwistLimiter, clip_to_finite

__all__ = ["TwistLimiter", "clip_to_finite"]
