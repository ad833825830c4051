"""Zenoh configuration: local-only by default, with short leases to detect dead peers."""

# pyright: reportUnknownMemberType=false
# The zenoh stubs omit return types of methods that return nothing.

from __future__ import annotations

import ipaddress
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

import zenoh

from tsd_twin.errors import BusError

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"

NO_ANSWER = "no answer from that address"
"""Reason shown if the peer of a session cannot be reached."""
_LEASE_MS = 1000
_FAR_LEASE_MS = 3000
"""Session timeout for slow links, where a stream may retransmit a keep-alive twice."""
_OPEN_MS = 5000
"""Handshake timeout. A handshake takes three round trips, at most 2.7 s on any link that still
allows commands.

Connections that took more than 4 s are reopened, see `half_open`.
"""
_ACCEPT_MS = 10_000
"""Much longer than `_OPEN_MS`, so that the accepting side never aborts a handshake that can
succeed.
"""
MOST_MESSAGE_BYTES = 4 << 20
"""Longest message that a session receives; longer ones are dropped before reassembly.

A hundred times the longest message of this project, and the limit for recordings.
"""
_MOST_RECEIVED = "transport/link/rx/max_message_size"
_DIAL_MS = 500
"""Longest pause between attempts to reach a router, so that all robots are back within a second."""
_MIXED = "?rel=1;mixed_rel=1"
_TLS = "transport/link/tls"
_FILES = (
    f"{_TLS}/root_ca_certificate",
    f"{_TLS}/listen_private_key",
    f"{_TLS}/listen_certificate",
    f"{_TLS}/connect_private_key",
    f"{_TLS}/connect_certificate",
    "transport/auth/usrpwd/dictionary_file",
)
"""Settings that contain a file name."""


@dataclass(frozen=True, slots=True)
class Config:
    """Configuration of a Zenoh session."""

    json5: str
    """Configuration in JSON5, with Zenoh's keys."""
    where: str
    """Name used in error messages: the endpoints or the file."""
    files: Mapping[str, Path] = field(default_factory=dict[str, Path])
    """Paths for settings that contain a file name; they override `json5`."""
    others: Mapping[str, str] = field(default_factory=dict[str, str])
    """Further overrides of `json5`, as JSON."""

    @property
    def is_client(self) -> bool:
        """Whether a session needs its router to open."""
        return json.loads(self.parsed().get_json("mode")) == "client"

    @property
    def robot(self) -> str | None:
        """Id of the robot that dials a router with this configuration, or None."""
        return self._metadata("robot")

    @property
    def renewal(self) -> str | None:
        """URL at which the certificate of this configuration is renewed, or None."""
        return self._metadata("renewal")

    def _metadata(self, key: str) -> str | None:
        metadata = json.loads(zenoh.Config.from_json5(self.json5).get_json("metadata"))
        if not isinstance(metadata, dict):
            return None
        return cast("dict[str, str]", metadata).get(key)

    @property
    def certificate(self) -> Path | None:
        """Own certificate for mutual TLS, or None."""
        return self.files.get(f"{_TLS}/connect_certificate")

    @property
    def key(self) -> Path | None:
        """Private key of the certificate, or None."""
        return self.files.get(f"{_TLS}/connect_private_key")

    @property
    def authority(self) -> Path | None:
        """Certificate of the authority, or None."""
        return self.files.get(f"{_TLS}/root_ca_certificate")

    def parsed(self) -> zenoh.Config:
        """Return the zenoh configuration object.

        Raises:
            zenoh.ZError: If zenoh does not know a key.
        """
        settings = zenoh.Config.from_json5(self.json5)
        for key, file in self.files.items():
            settings.insert_json5(key, json.dumps(str(file)))
        for key, value in self.others.items():
            settings.insert_json5(key, value)
        # A file may set a stricter limit, as for a robot with certificates.
        most = min(MOST_MESSAGE_BYTES, json.loads(settings.get_json(_MOST_RECEIVED)))
        settings.insert_json5(_MOST_RECEIVED, str(most))
        return settings


def node_config(listen: Sequence[str], connect: Sequence[str] = ()) -> Config:
    """Return the configuration of a robot node, which listens and routes between its peers.

    Raises:
        BusError: If an endpoint is malformed, or reachable by other machines without TLS and access
            control.
    """
    for endpoint in (*listen, *connect):
        _check_endpoint(endpoint)
    for endpoint in listen:
        _refuse_open_door(endpoint, guarded=False)
    settings = _common("router", connect, listen)
    settings["listen"] = {"endpoints": list(listen)}
    # The only way to learn the port chosen for ":0"; only the session itself can read it.
    settings["adminspace"] = {"enabled": True, "permissions": {"read": True, "write": False}}
    return Config(json.dumps(settings), ", ".join(listen))


def client_config(connect: Sequence[str]) -> Config:
    """Return the configuration of a dashboard or tool, which connects but does not listen.

    It is a peer rather than a client, because peers connect in the background, even if the robot
    starts later.

    Raises:
        BusError: If an endpoint is malformed.
    """
    for endpoint in connect:
        _check_endpoint(endpoint)
    settings = _common("peer", connect)
    settings["listen"] = {"endpoints": []}
    return Config(json.dumps(settings), ", ".join(connect))


def dialling_config(connect: Sequence[str]) -> Config:
    """Return the configuration of a robot, dashboard or tool that dials a router.

    It is a client, because peers of the same router do not reach each other. Its session opens when
    the router is there, see `Bus.when_reachable`.

    Raises:
        BusError: If an endpoint is malformed.
    """
    for endpoint in connect:
        _check_endpoint(endpoint)
    settings = _common("client", connect, retry_ms=_DIAL_MS)
    settings["listen"] = {"endpoints": []}
    return Config(json.dumps(settings), ", ".join(connect))


def as_client(config: Config, patience_s: float) -> Config:
    """Return a client configuration: a single connection that sees all peers, opened within a
    timeout.

    Peers connected to the same robot see the robot and clients, but not each other.
    """
    return replace(
        config,
        others={
            "mode": '"client"',
            "connect/timeout_ms": str(round(1000.0 * patience_s)),
            "connect/exit_on_failure": "true",
        },
    )


def clients_of(config: Config, patience_s: float) -> list[Config]:
    """Return a client configuration for each endpoint that a configuration connects to.

    Such a session opens within a timeout or fails, reconnects after a loss, and sees all peers of
    the robot.

    Raises:
        BusError: If Zenoh cannot read the configuration.
    """
    try:
        endpoints = _endpoints(config.parsed(), "connect/endpoints")
    except zenoh.ZError as error:
        raise BusError(f"{config.where}: {reason(error)}") from error
    client = as_client(config, patience_s)
    return [
        replace(
            client,
            where=endpoint,
            others={**client.others, "connect/endpoints": json.dumps([endpoint])},
        )
        for endpoint in endpoints
    ]


def from_file(path: str) -> Config:
    """Load a JSON5 configuration, for TLS and access control.

    Relative file names in it are resolved from its folder, so that the folder can be moved.

    Raises:
        BusError: If the file cannot be read, has a key unknown to Zenoh, names a missing file, or
            listens for other machines without TLS and access control.
    """
    try:
        text = Path(path).read_text("utf-8")
        parsed = zenoh.Config.from_json5(text)
        access = json.loads(parsed.get_json("access_control"))
        listening = _endpoints(parsed, "listen/endpoints")
        files = _files(parsed, Path(path).absolute().parent)
    except (zenoh.ZError, OSError, ValueError) as error:
        raise BusError(f"{path}: {reason(error)}") from error
    guarded = access["enabled"] and access["default_permission"] == "deny"
    for endpoint in listening:
        _refuse_open_door(endpoint, guarded=guarded)
    for file in files.values():
        if not file.is_file():
            # Sessions that connect in the background would not report it.
            raise BusError(f"{path} needs {file}, which is not there")
    return Config(text, path, files)


def router_file(path: str) -> Config:
    """Load the configuration of a router, with the checks of `from_file`.

    Raises:
        BusError: If it is not the configuration of a router that listens.
    """
    config = from_file(path)
    parsed = config.parsed()
    if json.loads(parsed.get_json("mode")) != "router" or not _endpoints(
        parsed, "listen/endpoints"
    ):
        raise BusError(f"{path} is not the configuration of a router: tsd-certs --router-host")
    return config


def over_datagrams(endpoint: str) -> str:
    """Return a `udp/` endpoint with settings for a lossy link: mixed datagrams and streams.

    One QUIC connection carries commands and states as datagrams, which are lost individually, and
    everything else as a retransmitting stream. It is neither encrypted nor authenticated, so use it
    on this machine only. Both sides need these settings.
    """
    return endpoint + _MIXED


def is_loopback(endpoint: str) -> bool:
    """Return whether an endpoint such as `tcp/127.0.0.1:7447` is local to this machine."""
    protocol, _, address = endpoint.partition("/")
    if protocol == "unixsock-stream":
        return True
    host = address.split("?")[0].split("#")[0].rpartition(":")[0].strip("[]")
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


_JSON5_ERROR = re.compile(r"--> (\d+):(\d+).*= (expected .*)", re.DOTALL)


def reason(error: Exception) -> str:
    """Return the reason in a Zenoh error, without source locations."""
    text = str(error).split(" at /")[0].strip()
    if "Unable to connect to any" in text:
        return NO_ANSWER
    for known in ("Address already in use", "Cannot assign requested address"):
        if known in text:
            return known.lower()
    if syntax := _JSON5_ERROR.search(text):
        return f"line {syntax[1]}, column {syntax[2]}: {syntax[3]}"
    return " ".join(text.split()).rstrip(".")


def _endpoints(settings: zenoh.Config, key: str) -> list[str]:
    found = json.loads(settings.get_json(key))
    if isinstance(found, dict):  # One list per mode.
        by_mode = cast("dict[str, list[str]]", found)
        return [endpoint for group in by_mode.values() for endpoint in group]
    return cast("list[str]", found or [])


def _files(settings: zenoh.Config, folder: Path) -> dict[str, Path]:
    named = {key: json.loads(settings.get_json(key)) for key in _FILES}
    return {key: folder / name for key, name in named.items() if name is not None}


def _common(
    mode: str, connect: Sequence[str], listen: Sequence[str] = (), retry_ms: int = 1000
) -> dict[str, Any]:
    far = any(endpoint.endswith(_MIXED) for endpoint in (*connect, *listen))
    return {
        "mode": mode,
        "connect": {
            "endpoints": list(connect),
            "timeout_ms": -1,  # Retry forever in the background; 0 would mean a single attempt.
            "exit_on_failure": False,
            "retry": {
                "period_init_ms": 100,
                "period_max_ms": retry_ms,
                "period_increase_factor": 2,
            },
        },
        "scouting": {
            "delay": 0,
            "multicast": {"enabled": False},
            "gossip": {"enabled": False},
        },
        "timestamping": {"enabled": True},  # Late joiners query events by time.
        "queries_default_timeout": 1000,
        "transport": {
            "unicast": {
                "open_timeout": _OPEN_MS,
                "accept_timeout": _ACCEPT_MS,
                "max_sessions": 64,
            },
            "link": {"tx": {"lease": _FAR_LEASE_MS if far else _LEASE_MS, "keep_alive": 4}},
            "shared_memory": {"enabled": False},
        },
        "low_pass_filter": [
            {
                "flows": ["ingress"],
                "messages": ["put", "query"],
                "key_exprs": ["twin/*/cmd/**", "twin/*/in/**", "twin/*/srv/**", "twin/*/stop"],
                "size_limit": 4096,
            }
        ],
    }


_WITH_PORT = re.compile(r"(?:tcp|udp|tls|quic|ws)/(?:\[[^\]/]+\]|[^\[\]/:]+):(\d{1,5})")


def _check_endpoint(endpoint: str) -> None:
    """Reject unusable endpoints, on which a background connection would wait forever.

    Raises:
        BusError: If protocol, host or port is missing, or the port is out of range.
    """
    protocol, slash, _ = endpoint.partition("/")
    if slash and protocol in ("unixsock-stream", "serial", "vsock", "unixpipe"):
        return
    match = _WITH_PORT.fullmatch(re.split(r"[?#]", endpoint)[0])
    if match is None or int(match[1]) > 65_535:
        raise BusError(f"'{endpoint}' is no endpoint: write it as {DEFAULT_ENDPOINT}")


def _refuse_open_door(endpoint: str, *, guarded: bool) -> None:
    if is_loopback(endpoint) or (guarded and endpoint.startswith(("tls/", "quic/"))):
        return
    if "/" not in endpoint:
        raise BusError(f"'{endpoint}' is no endpoint: write it as {DEFAULT_ENDPOINT}")
    raise BusError(
        f"{endpoint} can be reached by other machines, so it needs TLS and access control: "
        "tsd-certs makes a Zenoh configuration with both, to be given with --zenoh-config FILE; "
        f"or listen on {DEFAULT_ENDPOINT}"
    )
