"""The bus (Zenoh): sessions, configuration and handles; the only package that imports zenoh."""

from __future__ import annotations

from tsd_twin.bus.config import (
    DEFAULT_ENDPOINT,
    NO_ANSWER,
    Config,
    as_client,
    client_config,
    clients_of,
    dialling_config,
    from_file,
    node_config,
    over_datagrams,
    router_file,
)
from tsd_twin.bus.handles import PendingQuery, Publisher, Queryable, Subscriber, Token
from tsd_twin.bus.session import Bus

__all__ = [
    "DEFAULT_ENDPOINT",
    "NO_ANSWER",
    "Bus",
    "Config",
    "PendingQuery",
    "Publisher",
    "Queryable",
    "Subscriber",
    "Token",
    "as_client",
    "client_config",
    "clients_of",
    "dialling_config",
    "from_file",
    "node_config",
    "over_datagrams",
    "router_file",
]
