"""Enrolment at a robot: makes its key, asks a gateway for a certificate, and writes its files."""

from __future__ import annotations

import contextlib
from pathlib import Path

import msgspec

from tsd_twin.errors import TwinError, needs_extra
from tsd_twin.security.access_rules import AUTHORITY
from tsd_twin.security.authority_client import AuthorityClient, NoReplyError
from tsd_twin.security.certificates import (
    Certificate,
    Key,
    certificate_pem,
    identity_of,
    new_key,
    read_key,
    replace_file,
)
from tsd_twin.security.enrolment import (
    JOIN_PATH,
    PORT,
    EnrolmentCode,
    Joined,
    JoinRequest,
    fingerprint,
    seal,
    signing_request,
    unseal,
)
from tsd_twin.security.key_folder import KeyFolder
from tsd_twin.security.operator_list import OPERATORS
from tsd_twin.security.router_keys import robot_identity
from tsd_twin.security.signing_keys import key_pem

with needs_extra("Joining a router", "tls"):
    from cryptography import x509
    from cryptography.exceptions import InvalidSignature

_DRAFT = ".joining"
"""Name of the key until the name of the robot is known; it is not a valid id."""


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
    gateway, folder = AuthorityClient(url, PORT), KeyFolder(path)
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
        reply = gateway.send(authority, JOIN_PATH, message)
        joined = _checked(_unsealed(secret, reply, message), key, authority)
    except NoReplyError:
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
        gateway.send(
            authority, JOIN_PATH, seal(secret, msgspec.structs.replace(request, is_done=True))
        )
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
