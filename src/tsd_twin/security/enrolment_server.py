"""HTTPS server that enrols robots; only the process with the authority's key runs it."""

from __future__ import annotations

import logging
import os
import socket
import ssl
import threading
import time
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, Self, cast

import msgspec

from tsd_twin.errors import TwinError
from tsd_twin.security.access_rules import AUTHORITY, ROUTER
from tsd_twin.security.certificates import KeyFolder
from tsd_twin.security.enrolment import LARGEST_BYTES, EnrolmentError, Enrolments, Refusal
from tsd_twin.security.rate_limits import subscriber_network

_LOG = logging.getLogger(__name__)
DEFAULT_PORT = 7448
AUTHORITY_PATH, JOIN_PATH = "/ca.pem", "/join"
_TIMEOUT_S = 10.0
CONNECTIONS = 32
"""Connections at the same time; others are closed."""


def boot_time_s() -> float:
    """Return the time since boot; it also passes while the computer sleeps."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


class RefusalReply(msgspec.Struct, frozen=True):
    """Body of a reply that refuses; it is not authenticated, so it contains no text."""

    refusal: Refusal
    wait_s: int = 0


class EnrolmentServer:
    """Server on all addresses of this machine; use it as a context manager."""

    def __init__(self, enrolments: Enrolments, folder: KeyFolder, port: int) -> None:
        """Listen, with the certificate of the router in the folder.

        Raises:
            TwinError: If a file cannot be read, or the port is in use.
        """
        try:
            authority = folder.certificate_file(AUTHORITY).read_bytes()
            context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
            context.minimum_version = ssl.TLSVersion.TLSv1_3
            context.load_cert_chain(folder.certificate_file(ROUTER), folder.key_file(ROUTER))
        except OSError as error:
            raise TwinError(
                f"enrolment needs {ROUTER}.pem and {ROUTER}.key in {folder.path}: {error.strerror}"
            ) from error
        try:
            listening = _listen(port)
        except OSError as error:
            reason = os.strerror(error.errno or 0)
            raise TwinError(f"port {port} cannot be opened: {reason}") from error
        self.port: int = listening.getsockname()[1]
        self._server = _Server(enrolments, authority, context, listening)
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.1,))

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._server.shutdown()
        self._thread.join()
        self._server.server_close()


def _listen(port: int) -> socket.socket:
    """Listen on all IPv4 addresses, and on all IPv6 addresses if the machine has any."""
    if socket.has_dualstack_ipv6():
        try:
            return socket.create_server(("", port), family=socket.AF_INET6, dualstack_ipv6=True)
        except OSError:
            _LOG.info("no IPv6 on this machine, or the port is in use")
    return socket.create_server(("", port))


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    block_on_close = False  # A client that stalls does not delay the end.

    def __init__(
        self,
        enrolments: Enrolments,
        authority: bytes,
        context: ssl.SSLContext,
        listening: socket.socket,
    ) -> None:
        super().__init__(listening.getsockname()[:2], _Handler, bind_and_activate=False)
        self.socket.close()
        # The thread of a connection does the handshake, so that a client cannot block the others.
        self.socket = context.wrap_socket(
            listening, server_side=True, do_handshake_on_connect=False
        )
        self.authority = authority
        self._enrolments = enrolments
        self._lock = threading.Lock()
        self._free = threading.BoundedSemaphore(CONNECTIONS)

    def answer(self, message: bytes, address: str) -> bytes:
        """Return the reply to a request; errors as for `Enrolments.answer`."""
        with self._lock:
            return self._enrolments.answer(message, subscriber_network(address), boot_time_s())

    def process_request(self, request: Any, client_address: Any) -> None:
        if self._free.acquire(blocking=False):
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._free.release()

    def handle_error(self, request: Any, client_address: Any) -> None:  # noqa: ARG002
        _LOG.info("connection of %s failed", client_address[0], exc_info=True)


class _Handler(BaseHTTPRequestHandler):
    timeout = _TIMEOUT_S

    def do_GET(self) -> None:
        """Send the certificate of the authority, which is public."""
        if self.path == AUTHORITY_PATH:
            self._reply(HTTPStatus.OK, self._enrolling.authority)
        else:
            self.send_error(HTTPStatus.NOT_FOUND)

    def do_POST(self) -> None:
        """Answer a request for a certificate."""
        length = self.headers.get("Content-Length", "")
        if self.path != JOIN_PATH:
            self.send_error(HTTPStatus.NOT_FOUND)
        elif not (length.isascii() and length.isdigit() and int(length) <= LARGEST_BYTES):
            self.send_error(HTTPStatus.REQUEST_ENTITY_TOO_LARGE)
        else:
            self._join(self.rfile.read(int(length)))

    @property
    def _enrolling(self) -> _Server:
        return cast("_Server", self.server)

    def _join(self, message: bytes) -> None:
        address = self.client_address[0]
        try:
            self._reply(HTTPStatus.OK, self._enrolling.answer(message, address))
        except EnrolmentError as error:
            _LOG.warning("%s: %s", address, error)
            refusal = RefusalReply(error.refusal, error.wait_s)
            self._reply(HTTPStatus.FORBIDDEN, msgspec.json.encode(refusal))
        except TwinError as error:
            _LOG.error("%s", error)
            self.send_error(HTTPStatus.INTERNAL_SERVER_ERROR)

    def _reply(self, status: HTTPStatus, body: bytes) -> None:
        self.send_response(status)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002  Name of the base class.
        _LOG.info(format, *args)
