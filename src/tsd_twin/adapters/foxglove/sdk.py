"""Foxglove SDK server on the loopback interface, behind TLS with an ephemeral certificate.

The SDK checks neither origins nor tokens, so only the gateway connects to it. Browsers reject its
certificate, so web pages cannot bypass the gateway, which does not forward commands. This is the
only module that imports the SDK, which is an optional extra.
"""

from __future__ import annotations

import importlib
import logging
import ssl
import threading
from collections.abc import Callable, Collection, Sequence
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from typing import Any

from tsd_twin.adapters.ros_messages import RosMessage
from tsd_twin.adapters.ros_topics import LATCHED_TOPICS, STATUS, RosTopic
from tsd_twin.errors import MissingExtraError, TwinError
from tsd_twin.messages.ros_types import TRIGGER, decode_cdr, definition
from tsd_twin.security.access_rules import ROBOT, BusIdentity, Role
from tsd_twin.security.certificates import CertificateAuthority, certificate_pem, new_key
from tsd_twin.security.signing_keys import key_pem

LOOPBACK = "127.0.0.1"
SUBPROTOCOL = "foxglove.sdk.v1"
"""Protocol version that clients must offer."""
BACKLOG = 256
"""Maximum messages queued for a slow client; the oldest are dropped."""
_DAYS = 365
_REQUEST = b'{"type": "object", "properties": {}}'
_RESPONSE = (
    b'{"type": "object", "properties": {"success": {"type": "boolean"}, '
    b'"message": {"type": "string"}}}'
)


def load_sdk() -> Any:
    """Return the module `foxglove`.

    Raises:
        MissingExtraError: If it is not installed.
    """
    try:
        return importlib.import_module("foxglove")
    except ImportError as error:
        raise MissingExtraError("tsd-foxglove", "foxglove") from error


class SdkServer:
    """Channels, services and assets of all robots; thread-safe."""

    def __init__(
        self,
        name: str,
        *,
        may_drive: bool = False,
        playback_ns: tuple[int, int] | None = None,
        on_playback: Callable[[Any], Any] | None = None,
    ) -> None:
        """Listen on a free loopback port.

        For a recording, `playback_ns` is its first and last time. `on_playback` maps a
        `PlaybackControlRequest` of a client to a `PlaybackState`, on an SDK thread.

        Raises:
            MissingExtraError: If the SDK is not installed.
        """
        self._sdk = load_sdk()
        # It logs every client error, which could fill a disk; clients are notified anyway.
        logging.getLogger("foxglove").setLevel(logging.CRITICAL)
        web: Any = importlib.import_module("foxglove.websocket")
        self._context: Any = self._sdk.Context()
        self._channels: dict[str, Any] = {}
        self._users: dict[str, set[str]] = {}
        self._latched: dict[str, dict[str, bytes]] = {}
        self._assets: dict[str, Callable[[str], bytes | None]] = {}
        self._lock = threading.Lock()
        self._resending = ThreadPoolExecutor(1, "latched")
        certificate, key, self.trust = _own_certificate()
        able = web.Capability
        driving = [able.ClientPublish, able.Services] if may_drive else []
        self.server: Any = self._sdk.start_server(
            name=name,
            host=LOOPBACK,
            port=0,
            capabilities=[able.Time, *driving],
            server_listener=_listener(web, self._on_subscribe, on_playback),
            supported_encodings=["json", "cdr"] if may_drive else None,
            asset_handler=self._asset,
            context=self._context,
            playback_time_range=playback_ns,
            message_backlog_size=BACKLOG,
            tls_cert=certificate,
            tls_key=key,
        )
        self.port: int = self.server.port

    def close(self) -> None:
        """Close all connections and stop listening."""
        self.server.stop()
        self._resending.shutdown()

    # Messages.

    def declare(self, rows: Collection[tuple[RosTopic, str]], robot: str) -> None:
        """Advertise the topics of a robot, with their absolute names."""
        with self._lock:
            for row, name in rows:
                self._users.setdefault(name, set()).add(robot)
                if name not in self._channels:
                    self._channels[name] = self._new_channel(row, name)

    def wants(self, name: str) -> bool:
        """Return whether a client has subscribed to a topic."""
        channel = self._channels.get(name)
        return channel is not None and channel.has_sinks()

    def log(self, message: RosMessage, robot: str, log_ns: int | None = None) -> None:
        """Send a message to its subscribers; latched messages also reach later subscribers."""
        payload = message.payload
        if message.topic == STATUS:
            payload = decode_cdr(payload, STATUS.type).data.encode()
        with self._lock:
            channel = self._channels.get(message.name)
            if channel is None:
                return  # It was withdrawn.
            if message.topic in LATCHED_TOPICS:
                self._latched.setdefault(message.name, {})[robot] = payload
            channel.log(payload, log_time=log_ns)

    def forget(self, names: Collection[str], robot: str) -> None:
        """Withdraw a robot's topics, except those used by other robots."""
        with self._lock:
            for name in names:
                users = self._users.get(name, set())
                users.discard(robot)
                self._latched.get(name, {}).pop(robot, None)
                if not users and (channel := self._channels.pop(name, None)) is not None:
                    channel.close()

    def _new_channel(self, row: RosTopic, name: str) -> Any:
        if row == STATUS:
            # JSON fields can be plotted, unlike a text message.
            return self._sdk.Channel(name, message_encoding="json", context=self._context)
        text = definition(row.type).encode()
        schema = self._sdk.Schema(name=row.type, encoding="ros2msg", data=text)
        return self._sdk.Channel(name, message_encoding="cdr", schema=schema, context=self._context)

    def _on_subscribe(self, name: str) -> None:
        if name in self._latched:
            # The SDK holds its locks during subscription callbacks, so use another thread.
            self._resending.submit(self._resend, name)

    def _resend(self, name: str) -> None:
        with self._lock:
            kept = list(self._latched.get(name, {}).values())
            channel = self._channels.get(name)
        for payload in kept:
            if channel is not None:
                channel.log(payload)

    # Services and assets.

    def add_services(self, names: Sequence[str]) -> None:
        """Advertise services; the gateway answers the calls."""
        sdk = self._sdk
        schema = sdk.ServiceSchema(
            TRIGGER,
            request=_service_schema(sdk, f"{TRIGGER}_Request", _REQUEST),
            response=_service_schema(sdk, f"{TRIGGER}_Response", _RESPONSE),
        )
        services = [sdk.Service(name, schema=schema, handler=_refuse) for name in names]
        self.server.add_services(services)

    def remove_services(self, names: Sequence[str]) -> None:
        """Withdraw services."""
        self.server.remove_services(list(names))

    def set_assets(self, prefix: str, get: Callable[[str], bytes | None] | None) -> None:
        """Serve assets: `get` receives the rest of each URI that starts with `prefix`."""
        if get is None:
            self._assets.pop(prefix, None)
        else:
            self._assets[prefix] = get

    def _asset(self, uri: str) -> bytes | None:
        for prefix, get in list(self._assets.items()):
            if uri.startswith(prefix):
                return get(uri.removeprefix(prefix))
        return None


def _service_schema(sdk: Any, name: str, schema: bytes) -> Any:
    inner = sdk.Schema(name=name, encoding="jsonschema", data=schema)
    return sdk.MessageSchema(encoding="json", schema=inner)


def _refuse(_request: Any) -> bytes:
    raise TwinError("services are called through the front door of tsd-foxglove")


def _listener(
    web: Any, on_subscribe: Callable[[str], None], on_playback: Callable[[Any], Any] | None
) -> Any:
    """Return a listener that sends latched messages to new subscribers."""

    def subscribed(_self: Any, _client: Any, channel: Any) -> None:
        on_subscribe(channel.topic)

    methods: dict[str, Any] = {"on_subscribe": subscribed}
    if on_playback is not None:

        def requested(_self: Any, request: Any) -> Any:
            return on_playback(request)

        methods["on_playback_control_request"] = requested
    return type("_Listener", (web.ServerListener,), methods)()


def _own_certificate() -> tuple[bytes, bytes, ssl.SSLContext]:
    """Return certificate and key of the loopback port, and a context that trusts only these."""
    key, now = new_key(), datetime.now(UTC)
    authority = CertificateAuthority.new(new_key(), now)
    server = BusIdentity(ROBOT, Role.ROBOT)
    certificate = authority.issue_server(key, server, [LOOPBACK], now, _DAYS)
    trust = ssl.create_default_context(cadata=certificate_pem(authority.certificate))
    return certificate_pem(certificate).encode(), key_pem(key), trust
