"""Fixtures of the security tests."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.key_folders import FIRST, provision_folder


@pytest.fixture
def keys(tmp_path: Path) -> Path:
    """Folder with the keys and certificates of a robot and two people."""
    provision_folder(tmp_path / "keys", **FIRST)
    return tmp_path / "keys"
