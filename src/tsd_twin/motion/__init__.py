"""Turning what is asked for into what can be done."""

from tsd_twin.motion.limiter import TwistLimiter, within_reason

__all__ = ["TwistLimiter", "within_reason"]
