"""HTTPS server of the certificate authority, for enrolment and renewal.

Only the process with the authority's key runs it.
"""

from __future__ import annotations

import logging
import os
import socket
import ssl
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, Self, cast

import msgspec

from tsd_twin.errors import TwinError, needs_extra
from tsd_twin.security.access_rules import AUTHORITY, ROUTER
from tsd_twin.security.certificates import Certificate
from tsd_twin.security.enrolment import LARGEST_BYTES, EnrolmentError, Refusal
from tsd_twin.security.key_folder import KeyFolder
from tsd_twin.security.rate_limits import subscriber_network

with needs_extra("A certificate authority", "tls"):
    from cryptography import x509

_LOG = logging.getLogger(__name__)
AUTHORITY_PATH = "/ca.pem"
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


@dataclass(frozen=True, slots=True)
class Request:
    """Request of a robot or another client."""

    body: bytes
    network: str
    """Address of the client, for IPv6 its subscriber's network."""
    client: Certificate | None
    """Certificate of this authority, not expired, whose key the client has proven to own."""


Answer = Callable[[Request], bytes]
"""Returns the reply to a request; an `EnrolmentError` refuses it. Calls do not overlap."""


class AuthorityServer:
    """Server on all addresses of this machine; use it as a context manager."""

    def __init__(
        self, folder: KeyFolder, port: int, answers: Mapping[tuple[str, str], Answer]
    ) -> None:
        """Listen, with the certificate of the router in the folder.

        `answers` has the methods and paths that are served besides the authority's certificate.

        Raises:
            TwinError: If a file cannot be read, or the port is in use.
        """
        try:
            authority = folder.certificate_file(AUTHORITY).read_bytes()
            context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
            context.minimum_version = ssl.TLSVersion.TLSv1_3
            context.load_cert_chain(*_server_files(folder))
            context.load_verify_locations(cadata=authority.decode())
            context.verify_mode = ssl.CERT_OPTIONAL  # A robot that joins has none yet.
        except OSError as error:
            raise TwinError(
                f"clients need {ROUTER}.pem and {ROUTER}.key in {folder.path}: {error.strerror}"
            ) from error
        try:
            listening = _listen(port)
        except OSError as error:
            reason = os.strerror(error.errno or 0)
            raise TwinError(f"port {port} cannot be opened: {reason}") from error
        self.port: int = listening.getsockname()[1]
        public: dict[tuple[str, str], Answer] = {("GET", AUTHORITY_PATH): lambda _: authority}
        self._context, self._folder = context, folder
        self._server = _Server(public | dict(answers), context, listening)
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.1,))

    def reload(self) -> None:
        """Use the router's new certificate for new connections."""
        self._context.load_cert_chain(*_server_files(self._folder))

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._server.shutdown()
        self._thread.join()
        self._server.server_close()


def _server_files(folder: KeyFolder) -> tuple[Path, Path]:
    return folder.certificate_file(ROUTER), folder.key_file(ROUTER)


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
        answers: Mapping[tuple[str, str], Answer],
        context: ssl.SSLContext,
        listening: socket.socket,
    ) -> None:
        super().__init__(listening.getsockname()[:2], _Handler, bind_and_activate=False)
        self.socket.close()
        # The thread of a connection does the handshake, so that a client cannot block the others.
        self.socket = context.wrap_socket(
            listening, server_side=True, do_handshake_on_connect=False
        )
        self.answers = answers
        self._lock = threading.Lock()
        self._free = threading.BoundedSemaphore(CONNECTIONS)

    def answer(self, answer: Answer, request: Request) -> bytes:
        """Return the reply to a request."""
        with self._lock:
            return answer(request)

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
        """Answer a request without a body."""
        self._answer(b"")

    def do_POST(self) -> None:
        """Answer a request with a body."""
        length = self.headers.get("Content-Length", "")
        if not (length.isascii() and length.isdigit() and int(length) <= LARGEST_BYTES):
            self.send_error(HTTPStatus.REQUEST_ENTITY_TOO_LARGE)
        else:
            self._answer(self.rfile.read(int(length)))

    def _answer(self, body: bytes) -> None:
        server = cast("_Server", self.server)
        answer = server.answers.get((self.command, self.path))
        if answer is None:
            self.send_error(HTTPStatus.NOT_FOUND)
            return
        address = self.client_address[0]
        try:
            request = Request(body, subscriber_network(address), self._client())
            self._reply(HTTPStatus.OK, server.answer(answer, request))
        except EnrolmentError as error:
            _LOG.warning("%s: %s", address, error)
            refusal = RefusalReply(error.refusal, error.wait_s)
            self._reply(HTTPStatus.FORBIDDEN, msgspec.json.encode(refusal))
        except TwinError as error:
            _LOG.error("%s", error)
            self.send_error(HTTPStatus.INTERNAL_SERVER_ERROR)

    def _client(self) -> Certificate | None:
        # TLS has checked authority and dates, and that the client has the key.
        shown = cast("ssl.SSLSocket", self.connection).getpeercert(binary_form=True)
        return x509.load_der_x509_certificate(shown) if shown else None

    def _reply(self, status: HTTPStatus, body: bytes) -> None:
        self.send_response(status)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002  Name of the base class.
        _LOG.info(format, *args)
