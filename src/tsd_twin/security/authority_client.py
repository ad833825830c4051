"""HTTPS client of the certificate authority, for enrolment and renewal."""

from __future__ import annotations

import http.client
import ssl
from dataclasses import dataclass
from http import HTTPStatus
from pathlib import Path
from urllib.parse import urlsplit

import msgspec

from tsd_twin.errors import TwinError, needs_extra
from tsd_twin.security.authority_server import AUTHORITY_PATH, RefusalReply
from tsd_twin.security.certificates import Certificate, certificate_pem
from tsd_twin.security.enrolment import EnrolmentError

with needs_extra("A certificate authority", "tls"):
    from cryptography import x509

_TIMEOUT_S = 10.0
_LARGEST_REPLY_BYTES = 1_000_000
"""A list of several thousand operators."""


class NoReplyError(TwinError):
    """The authority did not answer; it may have processed the request."""


@dataclass(frozen=True, slots=True)
class ClientFiles:
    """Certificate and key with which a client proves its identity."""

    certificate: Path
    key: Path


class AuthorityClient:
    """Client of the process with the authority's key, at an address such as
    `https://lab.example:7448`.
    """

    def __init__(self, url: str, port: int) -> None:
        """Parse the address; `port` is used if it has none.

        Raises:
            TwinError: If it is malformed.
        """
        try:
            parts = urlsplit(url)
            self._host, self._port = parts.hostname, parts.port or port
        except ValueError:
            parts, self._host = urlsplit(""), None
        if parts.scheme != "https" or not self._host or parts.path not in ("", "/"):
            raise TwinError(f"'{url}' is not like https://lab.example:{port}")
        self.url = url

    def authority(self) -> Certificate:
        """Return the certificate of the authority, which anybody could have sent.

        Raises:
            TwinError: If the server does not answer, or sends something else.
        """
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        context.check_hostname = False
        context.verify_mode = ssl.CERT_NONE  # The code authenticates the certificate.
        status, content = self._exchange(context, "GET", AUTHORITY_PATH)
        try:
            if status == HTTPStatus.OK:
                return x509.load_pem_x509_certificate(content)
        except ValueError:
            pass
        raise TwinError(f"{self.url} is not a gateway: does tsd-certs run there?")

    def send(
        self,
        authority: Certificate,
        path: str,
        body: bytes | None = None,
        own: ClientFiles | None = None,
    ) -> bytes:
        """Return the reply to a request, over TLS with a server of this authority.

        Raises:
            EnrolmentError: If the authority refuses.
            TwinError: If it does not answer, or the server has no certificate of this authority.
        """
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        # Its name does not matter: the authority makes servers of routers only.
        context.check_hostname = False
        context.load_verify_locations(cadata=certificate_pem(authority))
        if own is not None:
            context.load_cert_chain(own.certificate, own.key)
        status, content = self._exchange(context, "GET" if body is None else "POST", path, body)
        if status == HTTPStatus.OK:
            return content
        try:
            reply = msgspec.json.decode(content, type=RefusalReply)
        except (msgspec.DecodeError, RecursionError):
            raise TwinError(
                f"{self.url} failed, see the output of tsd-certs there (status {status})"
            ) from None
        raise EnrolmentError(reply.refusal, reply.wait_s)

    def _exchange(
        self, context: ssl.SSLContext, method: str, path: str, body: bytes | None = None
    ) -> tuple[int, bytes]:
        connection = http.client.HTTPSConnection(
            self._host or "", self._port, timeout=_TIMEOUT_S, context=context
        )
        try:
            connection.request(method, path, body)
            response = connection.getresponse()
            return response.status, response.read(_LARGEST_REPLY_BYTES)
        except ssl.SSLCertVerificationError as error:
            raise TwinError(
                f"{self.url} has no valid certificate of the authority: "
                f"{error.verify_message}; is the clock of this computer right?"
            ) from error
        except (OSError, http.client.HTTPException) as error:
            late = f"timeout after {_TIMEOUT_S:.0f} s" if isinstance(error, TimeoutError) else None
            reason = late or getattr(error, "strerror", None) or type(error).__name__
            raise NoReplyError(
                f"{self.url} does not answer: {reason}; does tsd-certs run there?"
            ) from error
        finally:
            connection.close()
