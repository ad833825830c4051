"""Number types and base class of the tables of a robot description."""

from __future__ import annotations

from typing import Annotated, TypeAlias

import msgspec
from msgspec import Meta

Positive: TypeAlias = Annotated[float, Meta(gt=0.0)]
NotNegative: TypeAlias = Annotated[float, Meta(ge=0.0)]
Share: TypeAlias = Annotated[float, Meta(ge=0.0, le=1.0)]
Colour: TypeAlias = tuple[Share, Share, Share, Share]
"""Red, green, blue (sRGB) and opacity."""
Name: TypeAlias = Annotated[str, Meta(pattern=r"^[a-z0-9_-]{1,32}\Z")]
"""Names used in bus keys; the pattern ends in a strict anchor, as `$` accepts a trailing
newline."""
Problem: TypeAlias = tuple[str, str]
"""Problem of a description, and its remedy or ""."""


class Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Table of the file: unknown keys are errors, values are read-only."""
