"""Turning what is asked for into what can be done.

The core needs the limiter only. Paths, timing and tracking are imported from their modules.
"""

from tsd_twin.motion.limiter import TwistLimiter, within_reason

__all__ = ["TwistLimiter", "within_reason"]
