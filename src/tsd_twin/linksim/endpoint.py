"""Where a simulated link begins and ends."""

from __future__ import annotations

import ipaddress
import re
from dataclasses import dataclass
from typing import Self

from tsd_twin.linksim.errors import LinkError

_PATTERN = re.compile(
    r"(?P<protocol>tcp|udp)/(?P<host>\[[0-9A-Fa-f:.%]+\]|[^\[\]/:?#]+):(?P<port>\d{1,5})",
    re.ASCII,
)


@dataclass(frozen=True, slots=True)
class Endpoint:
    """A protocol, `tcp` or `udp`, a host and a port, as Zenoh writes them."""

    protocol: str
    host: str
    port: int

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{self.protocol}/{host}:{self.port}"

    @classmethod
    def parse(cls, text: str) -> Self:
        """Return the endpoint of a text such as `tcp/127.0.0.1:7447`.

        Raises:
            LinkError: it is written otherwise, or of another protocol.
        """
        match = _PATTERN.fullmatch(text.strip())
        if match is None or int(match["port"]) > 65535:
            raise LinkError(
                f"'{text}' is no endpoint of a link: write it as tcp/127.0.0.1:7447 "
                "or udp/127.0.0.1:7447"
            )
        return cls(match["protocol"], match["host"].strip("[]"), int(match["port"]))

    @property
    def is_loopback(self) -> bool:
        """Whether it is of this machine only."""
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return self.host == "localhost"
