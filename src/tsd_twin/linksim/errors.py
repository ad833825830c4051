"""What can be wrong with a simulated link."""

from __future__ import annotations

from tsd_twin.errors import TwinError


class LinkError(TwinError):
    """A link is described wrongly, or its endpoints cannot be used."""
