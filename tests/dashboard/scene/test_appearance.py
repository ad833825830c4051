"""Colours of the scene are those that the page's sheet of keys and colours names."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tsd_twin.dashboard.gateway.pages import STATIC
from tsd_twin.dashboard.scene import appearance

pytestmark = pytest.mark.computes


def test_the_sheet_names_the_colours_of_the_scene() -> None:
    text = Path(STATIC, "key_sheet.js").read_text("utf-8")
    named = dict(re.findall(r'\["(\w+)", "(#[0-9a-f]{6})", ', text))
    assert named
    for name, colour in named.items():
        assert colour == "#{:02x}{:02x}{:02x}".format(*getattr(appearance, name.upper()))
