"""The bus: the only door to zenoh."""

from tsd_twin.bus.bus import Bus, Publisher, Reader, Request, Server
from tsd_twin.bus.config import DEFAULT_ENDPOINT, Config, client_config, from_file, node_config

__all__ = [
    "DEFAULT_ENDPOINT",
    "Bus",
    "Config",
    "Publisher",
    "Reader",
    "Request",
    "Server",
    "client_config",
    "from_file",
    "node_config",
]
