"""Enrolment at a robot: makes its key, asks a gateway for a certificate, and writes its files."""

from __future__ import annotations

import contextlib
import http.client
import ssl
from http import HTTPStatus
from pathlib import Path
from urllib.parse import urlsplit

import msgspec

from tsd_twin.errors import TwinError, needs_extra
from tsd_twin.security.access_rules import AUTHORITY
from tsd_twin.security.certificates import (
    Certificate,
    Key,
    KeyFolder,
    certificate_pem,
    identity_of,
    key_pem,
    new_key,
    read_key,
    replace_file,
)
from tsd_twin.security.enrolment import (
    EnrolmentCode,
    EnrolmentError,
    Joined,
    JoinRequest,
    fingerprint,
    seal,
    signing_request,
    unseal,
)
from tsd_twin.security.enrolment_server import (
    AUTHORITY_PATH,
    DEFAULT_PORT,
    JOIN_PATH,
    RefusalReply,
)
from tsd_twin.security.operator_list import OPERATORS
from tsd_twin.security.router_keys import robot_identity

with needs_extra("Joining a router", "tls"):
    from cryptography import x509
    from cryptography.exceptions import InvalidSignature

_TIMEOUT_S = 10.0
_LARGEST_REPLY_BYTES = 1_000_000
"""A list of several thousand operators."""
_DRAFT = ".joining"
"""Name of the key until the name of the robot is known; it is not a valid id."""


class _NoReplyError(TwinError):
    """A gateway did not answer; it may have processed the request."""


class Gateway:
    """Process with the authority's key, at an address such as `https://lab.example:7448`."""

    def __init__(self, url: str) -> None:
        """Parse the address.

        Raises:
            TwinError: If it is malformed.
        """
        try:
            parts = urlsplit(url)
            self._host, self._port = parts.hostname, parts.port or DEFAULT_PORT
        except ValueError:
            parts, self._host = urlsplit(""), None
        if parts.scheme != "https" or not self._host or parts.path not in ("", "/"):
            raise TwinError(f"--join: '{url}' is not like https://lab.example:{DEFAULT_PORT}")
        self.url = url

    def authority(self) -> Certificate:
        """Return the certificate of its authority, which anybody could have sent.

        Raises:
            TwinError: If the gateway does not answer, or sends something else.
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
        raise TwinError(f"{self.url} is not a gateway: does tsd-certs --enrol run there?")

    def ask(self, authority: Certificate, message: bytes) -> bytes:
        """Return the reply to a request, over TLS with a server of this authority.

        Raises:
            EnrolmentError: If the gateway refuses.
            TwinError: If it does not answer, or has no certificate of this authority.
        """
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        # Its name does not matter: the authority makes servers of routers only, and the reply
        # proves that the gateway has the code.
        context.check_hostname = False
        context.load_verify_locations(cadata=certificate_pem(authority))
        status, content = self._exchange(context, "POST", JOIN_PATH, message)
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
                f"{self.url} has no valid certificate of the authority in the code: "
                f"{error.verify_message}; is the clock of this computer right?"
            ) from error
        except (OSError, http.client.HTTPException) as error:
            late = f"timeout after {_TIMEOUT_S:.0f} s" if isinstance(error, TimeoutError) else None
            reason = late or getattr(error, "strerror", None) or type(error).__name__
            raise _NoReplyError(
                f"{self.url} does not answer: {reason}; repeat this while tsd-certs --enrol runs "
                "there"
            ) from error
        finally:
            connection.close()


def join(url: str, code: EnrolmentCode, path: Path, robot: str | None = None) -> Path:
    """Enrol this computer as a robot, write its files, and return its configuration.

    If it was interrupted, or the answer was lost, repeat it while the code is good.

    Args:
        url: Address of the gateway.
        code: Code that the gateway has printed.
        path: Folder for the files; created if needed.
        robot: Id that the robot must get, None for any.

    Raises:
        EnrolmentError: If the gateway refuses.
        TwinError: If the gateway does not answer or has not proven its authority, or a file cannot
            be written.
    """
    gateway, folder = Gateway(url), KeyFolder(path)
    authority = gateway.authority()
    if fingerprint(authority) != code.fingerprint:
        raise TwinError(
            f"{url} has another authority than the code: check the address, and the last six "
            "characters of the code"
        )
    if folder.certificate_file(AUTHORITY).exists() and folder.authority_certificate() != authority:
        raise TwinError(f"{path} has keys of another authority: choose another --keys")
    secret = code.key(authority)
    draft, is_new_folder = folder.key_file(_DRAFT), not path.exists()
    is_new = not draft.exists()
    key = new_key() if is_new else read_key(draft)
    if is_new:
        folder.make()
        replace_file(draft, key_pem(key), 0o600)
    request = JoinRequest(signing_request(key), robot)
    try:
        message = seal(secret, request)
        reply = gateway.ask(authority, message)
        joined = _checked(_unsealed(secret, reply, message), key, authority)
    except _NoReplyError:
        raise  # The gateway may have signed this key, so it must be kept.
    except TwinError:
        if is_new:
            draft.unlink()
        if is_new_folder:
            with contextlib.suppress(OSError):
                path.rmdir()
        raise
    _write(folder, key, authority, joined)
    with contextlib.suppress(TwinError):  # The code then remains good for this key for a while.
        gateway.ask(authority, seal(secret, msgspec.structs.replace(request, is_done=True)))
    draft.unlink()
    return folder.settings_file(joined.robot)


def _unsealed(secret: bytes, reply: bytes, request: bytes) -> Joined:
    """Decode the reply to a request.

    Raises:
        TwinError: If the gateway does not have the code, or the reply has another form.
    """
    try:
        return unseal(secret, reply, Joined, request)
    except InvalidSignature:
        raise TwinError("the gateway does not know this code: nothing was written") from None
    except msgspec.DecodeError as error:
        raise TwinError(f"the reply of the gateway cannot be read: {error}") from error


def _checked(joined: Joined, key: Key, authority: Certificate) -> Joined:
    """Return a reply whose certificate is for this key.

    Raises:
        TwinError: If it is not.
    """
    identity = robot_identity(joined.robot)
    try:
        certificate = x509.load_pem_x509_certificate(joined.certificate.encode())
        certificate.verify_directly_issued_by(authority)
    except (ValueError, TypeError, InvalidSignature) as error:
        raise TwinError("the gateway sent a certificate of another authority") from error
    if certificate.public_key() != key.public_key() or identity_of(certificate) != identity:
        raise TwinError("the gateway sent a certificate of another robot")
    return joined


def _write(folder: KeyFolder, key: Key, authority: Certificate, joined: Joined) -> None:
    """Write the files; the configuration is last, so that it never lacks a file.

    Raises:
        TwinError: If a file cannot be written, or another key with the same name exists.
    """
    key_file = folder.key_file(joined.robot)
    if not key_file.exists():
        replace_file(key_file, key_pem(key), 0o600)
    elif read_key(key_file).private_numbers() != key.private_numbers():
        raise TwinError(f"{key_file} exists already: move it away, and repeat this")
    replace_file(folder.certificate_file(joined.robot), joined.certificate.encode())
    replace_file(folder.certificate_file(AUTHORITY), certificate_pem(authority).encode())
    replace_file(folder.path / OPERATORS, joined.operators.encode())
    replace_file(folder.settings_file(joined.robot), joined.settings.encode())
