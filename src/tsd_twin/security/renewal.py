"""Renewal of certificates in the last third of their life; the keys stay.

At the authority, `Renewals` answers clients that still have a valid certificate. At a client,
`CertificateRenewal` asks for the next one. Zenoh reads the new file when the link of the old
certificate ends, so a session continues without a restart.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

from tsd_twin.errors import TwinError, needs_extra
from tsd_twin.security.access_rules import ROUTER, BusIdentity
from tsd_twin.security.authority_client import AuthorityClient, ClientFiles
from tsd_twin.security.authority_server import Answer, Request
from tsd_twin.security.certificates import (
    Certificate,
    CertificateAuthority,
    certificate_pem,
    hosts_of,
    identity_of,
    read_certificate,
    replace_file,
)
from tsd_twin.security.enrolment import EnrolmentError, Refusal
from tsd_twin.security.key_folder import KeyFolder
from tsd_twin.security.operator_list import OPERATORS, decode_list

with needs_extra("Renewal of a certificate", "tls"):
    from cryptography import x509
    from cryptography.exceptions import InvalidSignature
    from cryptography.hazmat.primitives.asymmetric import ec

_LOG = logging.getLogger(__name__)
PORT = 7449
RENEW_PATH, OPERATORS_PATH = "/renew", f"/{OPERATORS}"
PERIOD_S = 10.0
"""Time after which a client looks again, so that a revoked operator is soon known everywhere."""
_SAME_FAULT = 360
"""Periods after which a fault that lasts is logged again."""


def utc_now() -> datetime:
    """Return the current time."""
    return datetime.now(UTC)


def is_due(certificate: Certificate, now: datetime) -> bool:
    """Return whether a certificate is in the last third of its life."""
    start, end = certificate.not_valid_before_utc, certificate.not_valid_after_utc
    return now > end - (end - start) / 3


class Renewals:
    """Renews the certificates of a router's folder; one that was removed is not renewed."""

    def __init__(
        self,
        folder: KeyFolder,
        authority: CertificateAuthority,
        days: int,
        clock: Callable[[], datetime] = utc_now,
    ) -> None:
        self._folder = folder
        self._authority = authority
        self._days = days
        self._clock = clock

    @property
    def answers(self) -> dict[tuple[str, str], Answer]:
        """Answers for an `AuthorityServer`."""
        return {("POST", RENEW_PATH): self.renew, ("GET", OPERATORS_PATH): self.operators}

    def renew(self, request: Request) -> bytes:
        """Return the current certificate (PEM) of a client for the same key.

        Raises:
            EnrolmentError: If the client has no certificate, or not the one in the folder.
            TwinError: If a file cannot be read or written.
        """
        name, current = self._known(request)
        if is_due(current, self._clock()):
            current = self._issued(identity_of(current), current)
            self._folder.write_certificate(name, current)
            _LOG.warning("renewed the certificate of %s", name)
        return certificate_pem(current).encode()

    def operators(self, request: Request) -> bytes:
        """Return the signed list of operators.

        Raises:
            EnrolmentError: If the client has no certificate, or not the one in the folder.
            TwinError: If the list cannot be read.
        """
        self._known(request)
        try:
            return (self._folder.path / OPERATORS).read_bytes()
        except OSError as error:
            raise TwinError(f"{error.filename} cannot be read: {error.strerror}") from error

    def renew_router(self) -> bool:
        """Renew the certificate of the router itself, and return whether it was due.

        Raises:
            TwinError: If a file cannot be read or written.
        """
        current = read_certificate(self._folder.certificate_file(ROUTER))
        if not is_due(current, self._clock()):
            return False
        self._folder.write_certificate(ROUTER, self._issued(identity_of(current), current))
        _LOG.warning("renewed the certificate of the router")
        return True

    def _known(self, request: Request) -> tuple[str, Certificate]:
        """Return name and newest certificate of a client.

        Raises:
            EnrolmentError: If the folder has none with this name, role and key.
        """
        if request.client is not None:
            identity = identity_of(request.client)
            file = self._folder.certificate_file(identity.name)
            if file.exists():
                current = read_certificate(file)
                if is_for_same(current, request.client):
                    return identity.name, current
        raise EnrolmentError(Refusal.REVOKED)

    def _issued(self, identity: BusIdentity, current: Certificate) -> Certificate:
        key, now, hosts = current.public_key(), self._clock(), hosts_of(current)
        if not isinstance(key, ec.EllipticCurvePublicKey):
            raise TwinError(f"the certificate of {identity.name} was not made by tsd-certs")
        if hosts:
            return self._authority.issue_server(key, identity, hosts, now, self._days)
        return self._authority.issue_client(key, identity, now, self._days)


def is_for_same(one: Certificate, other: Certificate) -> bool:
    """Return whether two certificates have the same key, name and role."""
    return one.public_key() == other.public_key() and identity_of(one) == identity_of(other)


class CertificateRenewal:
    """Keeps the certificate of a client valid, and at a robot the list of operators current."""

    def __init__(
        self, url: str, own: ClientFiles, authority: Path, operators: Path | None = None
    ) -> None:
        """Parse the address.

        Args:
            url: Address of `tsd-certs --renew`.
            own: Certificate and key to renew and to identify with.
            authority: Certificate of the authority.
            operators: Signed list to update, or None.

        Raises:
            TwinError: If the address is malformed.
        """
        self._client = AuthorityClient(url, PORT)
        self._own = own
        self._authority = authority
        self._operators = operators
        self._fault, self._repeated = "", 0

    def update(self, now: datetime) -> None:
        """Fetch a newer list of operators, and a certificate if the present one is due.

        Raises:
            EnrolmentError: If the authority refuses.
            TwinError: If it does not answer, sends something else, or a file cannot be written.
        """
        authority, current = (
            read_certificate(self._authority),
            read_certificate(self._own.certificate),
        )
        if self._operators is not None:
            self._update_operators(authority, self._operators)
        if not is_due(current, now):
            return
        content = self._client.send(authority, RENEW_PATH, b"", self._own)
        try:
            new = x509.load_pem_x509_certificate(content)
            new.verify_directly_issued_by(authority)
        except (ValueError, TypeError, InvalidSignature) as error:
            raise TwinError(f"{self._client.url} sent something else than a certificate") from error
        if not is_for_same(new, current):
            raise TwinError(f"{self._client.url} sent a certificate of another client")
        if new.not_valid_after_utc <= current.not_valid_after_utc:
            return
        # On the machine of the authority, it has replaced this very file.
        if read_certificate(self._own.certificate) != new:
            replace_file(self._own.certificate, certificate_pem(new).encode())

    def run(self, stop: threading.Event, period_s: float = PERIOD_S) -> None:
        """Update again and again until `stop` is set; a fault is logged, and tried again."""
        while True:
            try:
                self.update(utc_now())
                self._fault = ""
            except TwinError as error:
                self._log(str(error))
            if stop.wait(period_s):
                return

    def _log(self, fault: str) -> None:
        self._repeated = self._repeated + 1 if fault == self._fault else 0
        if self._repeated % _SAME_FAULT == 0:
            _LOG.warning("certificate %s is not renewed: %s", self._own.certificate, fault)
        self._fault = fault

    def _update_operators(self, authority: Certificate, file: Path) -> None:
        key = authority.public_key()
        if not isinstance(key, ec.EllipticCurvePublicKey):
            raise TwinError(f"{self._authority} was not made by tsd-certs")
        content = self._client.send(authority, OPERATORS_PATH, own=self._own)
        new = decode_list(content, key)
        # A missing or damaged list is replaced, too; the robot refuses an older one.
        try:
            if new.number <= decode_list(file.read_bytes(), key).number:
                return
        except (OSError, TwinError):
            pass
        replace_file(file, content)
