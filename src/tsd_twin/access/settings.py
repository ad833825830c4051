"""Zenoh configurations with TLS and access rules, as data."""

from __future__ import annotations

import copy
import re
from collections.abc import Mapping, Sequence
from typing import Any

from tsd_twin.access.identity import AUTHORITY, ROBOT, Identity
from tsd_twin.access.rules import EVERYTHING, access_control
from tsd_twin.errors import TwinError

LISTEN = "tls/0.0.0.0:7447"
LARGEST_BYTES = 65536
"""A robot puts together no message beyond this; a command has 108, a request a few hundred."""
_PORT = re.compile(r"^tls/.*?:(\d+)(?:[?#].*)?$")


def robot_settings(
    base: Mapping[str, Any], listen: str, people: Sequence[Identity]
) -> dict[str, Any]:
    """Return the settings of a robot node that other machines can reach.

    `base` are the settings of one that listens nowhere; files are named relative to the
    configuration itself.
    """
    settings = _with_tls(
        base,
        {
            "listen_private_key": f"{ROBOT}.key",
            "listen_certificate": f"{ROBOT}.pem",
        },
    )
    settings["listen"] = {"endpoints": [listen]}
    settings["access_control"] = access_control(people)
    settings["transport"]["link"]["rx"] = {"max_message_size": LARGEST_BYTES}
    # Nothing that anybody says to a robot is large, whatever it is about.
    for limit in settings["low_pass_filter"]:
        limit["key_exprs"] = list(EVERYTHING)
    return settings


def client_settings(base: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Return the settings of a dashboard or a tool; `base` are those of one without TLS."""
    return _with_tls(
        base,
        {
            "connect_private_key": f"{name}.key",
            "connect_certificate": f"{name}.pem",
            "verify_name_on_connect": True,
        },
    )


def endpoint(host: str, robot: Mapping[str, Any]) -> str:
    """Return where clients connect to a robot with these settings that is known as `host`.

    Raises:
        TwinError: the settings do not begin with an endpoint that has a port.
    """
    try:
        port = _PORT.search(robot["listen"]["endpoints"][0])
    except (LookupError, TypeError):
        port = None
    if port is None:
        raise TwinError(f"{ROBOT}.json5 must listen at an endpoint with a port, such as {LISTEN}")
    return f"tls/[{host}]:{port[1]}" if ":" in host else f"tls/{host}:{port[1]}"


def _with_tls(base: Mapping[str, Any], files: Mapping[str, Any]) -> dict[str, Any]:
    settings = copy.deepcopy(dict(base))
    settings["transport"]["link"] |= {
        "protocols": ["tls"],
        "tls": {
            "root_ca_certificate": f"{AUTHORITY}.pem",
            "enable_mtls": True,
            # What has run out must not go on because it began in time.
            "close_link_on_expiration": True,
            **files,
        },
    }
    return settings
