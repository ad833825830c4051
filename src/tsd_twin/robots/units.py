"""Units that descriptions use and nothing else does."""

from __future__ import annotations

import math

RPM = math.pi / 30.0
"""One turn a minute in radians a second."""
