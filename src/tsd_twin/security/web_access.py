"""HTTP access checks: `Host` and `Origin` headers, and TLS for web servers."""

from __future__ import annotations

import ipaddress
import re
import ssl
from collections.abc import Collection
from pathlib import Path

from cryptography import x509

from tsd_twin.errors import TwinError
from tsd_twin.security.users import refuse_public

_HOST = re.compile(
    r"(?P<name>[a-z0-9](?:[a-z0-9._-]{0,251}[a-z0-9])?|\[(?P<ipv6>[0-9a-f:.]{2,45})\])"
    r"(?::(?P<port>[1-9][0-9]{0,4}))?"
)
"""`name`, `address` or `[IPv6 address]`, each with or without a port."""
_ORIGIN = re.compile(rf"(?P<scheme>https?)://(?P<host>{_HOST.pattern})")


def origin_refusal(
    host: str | None,
    origin: str | None,
    port: int,
    allowed_hosts: Collection[str],
    *,
    addresses: bool = False,
    secure: bool = False,
) -> str | None:
    """Return why a request is refused by its `Host` and `Origin` headers, or None.

    A page of another site can make a browser send requests to this machine, also under a name that
    it resolves to this machine (DNS rebinding), but it can forge neither header. With `addresses`,
    any IP address with our port is accepted too, because addresses cannot be rebound. With
    `secure`, a page loaded without TLS counts as another site.
    """
    if host is None or not _is_known_host(
        host, port, allowed_hosts, addresses=addresses, secure=secure
    ):
        return (
            f"This gateway does not answer to the name '{host or ''}': "
            f"open http://127.0.0.1:{port}/ or start it with --allow-host and that name."
        )
    if origin is not None and not _is_same_origin(origin, host, secure=secure):
        return f"A page of {origin} may not speak to this gateway."
    return None


def host_of_origin(origin: str) -> str | None:
    """Return the host of an origin, with its port; None for anything but a web origin."""
    parts = _ORIGIN.fullmatch(_lower(origin))
    return None if parts is None else parts["host"]


def name_of_host(host: str) -> str:
    """Return a valid host without its port, in lower case; an IPv6 address in brackets."""
    parts = _HOST.fullmatch(_lower(host))
    return host if parts is None else parts["name"]


def is_loopback(name: str) -> bool:
    """Return whether a host name or address without port is a loopback one."""
    if name.lower() == "localhost":
        return True
    try:
        return ipaddress.ip_address(name).is_loopback
    except ValueError:
        return False


def is_address(name: str) -> bool:
    """Return whether a host is an IP address; names can be rebound by DNS."""
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def _is_known_host(
    host: str, port: int, allowed_hosts: Collection[str], *, addresses: bool, secure: bool
) -> bool:
    parts = _HOST.fullmatch(_lower(host))
    if parts is None:
        return False
    if parts[0] in {name.lower() for name in allowed_hosts}:
        return True
    name = parts["ipv6"] or parts["name"]
    known = is_loopback(name) or (addresses and is_address(name))
    if parts["ipv6"] is not None and ":" not in name:  # Brackets are for IPv6 only.
        return False
    return known and int(parts["port"] or (443 if secure else 80)) == port


def _is_same_origin(origin: str, host: str, *, secure: bool) -> bool:
    parts = _ORIGIN.fullmatch(_lower(origin))
    if parts is None or (secure and parts["scheme"] != "https"):
        return False
    return parts["host"] == _lower(host)


def _lower(text: str) -> str:
    """Convert ASCII text to lower case; return other text unchanged."""
    return text.lower() if text.isascii() else text


def server_tls_context(certificate: Path, key: Path) -> ssl.SSLContext:
    """Return the TLS context of a server, version 1.2 or newer.

    Raises:
        TwinError: If a file is missing, others can read the key, or key and certificate do not
            match.
    """
    certificate_host_names(certificate)
    refuse_public(key)
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    try:
        # Without a password function OpenSSL would prompt on the terminal and block.
        context.load_cert_chain(certificate, key, password=lambda: "")
    except ssl.SSLError as error:
        if error.reason == "KEY_VALUES_MISMATCH":
            raise TwinError(f"{key} is not the key of {certificate}") from error
        raise TwinError(f"{key} cannot be read as a private key without a passphrase") from error
    except OSError as error:
        raise TwinError(f"{key} cannot be read: {error.strerror}") from error
    return context


def certificate_host_names(certificate: Path) -> list[str]:
    """Return the host names in the first certificate of a file, without wildcards.

    Raises:
        TwinError: If the file contains no certificate.
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
