"""TLS of the gateway, by files of a certificate and its key."""

from __future__ import annotations

import ssl
from pathlib import Path

from cryptography import x509

from tsd_twin.access import refuse_public
from tsd_twin.errors import TwinError


def server_context(certificate: Path, key: Path) -> ssl.SSLContext:
    """Return what a server needs to speak TLS 1.2 or newer.

    Raises:
        TwinError: a file is missing, others can read the key, or the two do not belong together.
    """
    names_of(certificate)
    refuse_public(key)
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    try:
        # Without a password function OpenSSL would ask at the terminal, and wait.
        context.load_cert_chain(certificate, key, password=lambda: "")
    except ssl.SSLError as error:
        if error.reason == "KEY_VALUES_MISMATCH":
            raise TwinError(f"{key} is not the key of {certificate}") from error
        raise TwinError(f"{key} cannot be read as a private key without a passphrase") from error
    except OSError as error:
        raise TwinError(f"{key} cannot be read: {error.strerror}") from error
    return context


def names_of(certificate: Path) -> list[str]:
    """Return the host names, without patterns, that the first certificate in a file is good for.

    Raises:
        TwinError: there is none in the file.
    """
    try:
        first = x509.load_pem_x509_certificates(certificate.read_bytes())[0]
    except OSError as error:
        raise TwinError(f"{certificate} cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise TwinError(f"{certificate} cannot be read as a certificate in PEM") from error
    try:
        names = first.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except (x509.ExtensionNotFound, ValueError):
        return []
    return [name for name in names.get_values_for_type(x509.DNSName) if "*" not in name]
