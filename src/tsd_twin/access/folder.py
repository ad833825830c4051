"""The folder with keys, certificates and configurations; it is its own register."""

from __future__ import annotations

import json
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

from tsd_twin.access import pem, pki
from tsd_twin.access.identity import AUTHORITY, ROBOT, Identity, Role
from tsd_twin.access.pki import CertificateAuthority
from tsd_twin.errors import TwinError


class KeyFolder:
    """Certificates say who there is, so no list can disagree with them."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.made: list[Path] = []
        """Files that were written, in order."""

    # Where things are.

    def certificate_file(self, name: str) -> Path:
        """Return where a certificate is."""
        return self.path / f"{name}.pem"

    def key_file(self, name: str) -> Path:
        """Return where a private key is."""
        return self.path / f"{name}.key"

    def settings_file(self, name: str) -> Path:
        """Return where the configuration of the robot or of a client is."""
        return self.path / f"{name}.json5"

    def files_of(self, name: str) -> list[Path]:
        """Return what the machine of the robot or of a client needs; nothing else may go there."""
        own = [self.certificate_file(name), self.key_file(name), self.settings_file(name)]
        return [self.certificate_file(AUTHORITY), *own]

    # What there is.

    def people(self) -> list[Identity]:
        """Return who has a certificate here, by name.

        Raises:
            TwinError: a certificate is none of ours.
        """
        files = sorted(f for f in self.path.glob("*.pem") if f.stem != AUTHORITY)
        return [p for p in map(certificate_identity, files) if p.role is not Role.ROBOT]

    def hosts(self) -> list[str]:
        """Return the names and addresses in the certificate of the robot, if there is one."""
        file = self.certificate_file(ROBOT)
        return pki.hosts_of(pem.read_certificate(file)) if file.exists() else []

    def end_of(self, name: str) -> datetime:
        """Return when a certificate runs out."""
        return pem.read_certificate(self.certificate_file(name)).not_valid_after_utc

    def settings(self, name: str) -> dict[str, Any] | None:
        """Return the configuration of the robot or of a client, if there is one.

        Raises:
            TwinError: it is not JSON below lines of comment.
        """
        file = self.settings_file(name)
        if not file.exists():
            return None
        try:
            lines = file.read_text("utf-8").splitlines()
            return json.loads("\n".join(x for x in lines if not x.lstrip().startswith("//")))
        except (OSError, ValueError) as error:
            raise TwinError(
                f"{file} was changed and can no longer be read here: move it away, run this again, "
                "and bring your changes back as JSON"
            ) from error

    # What is made.

    def make(self) -> None:
        """Make the folder, for its owner alone.

        Raises:
            TwinError: it cannot be made.
        """
        try:
            self.path.mkdir(mode=0o700, parents=True, exist_ok=True)
        except OSError as error:
            raise TwinError(f"{self.path} cannot be made: {error.strerror}") from error

    def authority(self, now: datetime) -> CertificateAuthority:
        """Return the authority, a new one when there is none.

        Raises:
            TwinError: a part of it is missing, or its parts do not belong together.
        """
        file, key_file = self.certificate_file(AUTHORITY), self.key_file(AUTHORITY)
        if not file.exists() and not key_file.exists():
            authority = CertificateAuthority.new(self.key(AUTHORITY), now)
            self.keep(AUTHORITY, authority.certificate)
            return authority
        for needed in (file, key_file):
            if not needed.exists():
                raise TwinError(
                    f"nothing can be signed without {needed}: bring it back from where it is kept"
                )
        authority = CertificateAuthority(pem.read_key(key_file), pem.read_certificate(file))
        if authority.key.public_key() != authority.certificate.public_key():
            raise TwinError(f"{key_file} is not the key of {file}")
        return authority

    def key(self, name: str) -> pem.Key:
        """Return the key there is, so that a certificate alone can be renewed, or a new one."""
        file = self.key_file(name)
        if file.exists():
            return pem.read_key(file)
        key = pki.new_key()
        pem.write_key(file, key)
        self.made.append(file)
        return key

    def keep(self, name: str, certificate: pem.Certificate) -> None:
        """Write a certificate."""
        pem.write_certificate(self.certificate_file(name), certificate)
        self.made.append(self.certificate_file(name))

    def keep_settings(self, name: str, head: str, settings: Mapping[str, Any]) -> None:
        """Write a configuration below a head of comments, unless it is so already."""
        if self.settings(name) != settings:
            text = head + json.dumps(settings, indent=2) + "\n"
            pem.replace(self.settings_file(name), text.encode())
            self.made.append(self.settings_file(name))


def certificate_identity(file: Path) -> Identity:
    """Return whom the certificate in a file was issued to.

    Raises:
        TwinError: it cannot be read, or is none of ours.
    """
    return pki.identity_of(pem.read_certificate(file))
