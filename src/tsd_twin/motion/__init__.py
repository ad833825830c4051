"""Turning what is asked for into what can be done."""

from tsd_twin.motion.limiter import TwistLimiter

__all__ = ["TwistLimiter"]
