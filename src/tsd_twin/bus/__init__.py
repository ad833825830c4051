"""The bus: the only door to zenoh."""

from tsd_twin.bus.bus import Bus
from tsd_twin.bus.config import (
    DEFAULT_ENDPOINT,
    Config,
    as_client,
    client_config,
    from_file,
    node_config,
    over_datagrams,
)
from tsd_twin.bus.ends import Publisher, Reader, Request, Server, Token

__all__ = [
    "DEFAULT_ENDPOINT",
    "Bus",
    "Config",
    "Publisher",
    "Reader",
    "Request",
    "Server",
    "Token",
    "as_client",
    "client_config",
    "from_file",
    "node_config",
    "over_datagrams",
]
