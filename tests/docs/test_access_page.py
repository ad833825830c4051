"""Numbers, commands and texts of the access page match the code."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.support.markdown_pages import ROOT, code, page, quoted, section, tables
from tsd_twin.dashboard.gateway.connection_limits import ConnectionLimits
from tsd_twin.dashboard.gateway.login import READ_S
from tsd_twin.security.users import ABSOLUTE_S, IDLE_S, Logins

PAGE = page("access.md")
SOURCES = [*(ROOT / "src/tsd_twin").rglob("*.py"), *(ROOT / "app").glob("*.py")]


def spoken(file: Path) -> str:
    """Return the text of a file with its string literals joined, as displayed."""
    return re.sub(r'"\s*f?"', "", file.read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    "sentence",
    [quoted(row[0])[0] for row in tables(section(PAGE, "## When it does not work"))[0][:6]],
)
def test_what_it_says_is_what_is_said(sentence: str) -> None:
    parts = [part.strip() for part in re.split(r"\.\.\.|0\.0\.0\.0", sentence) if part.strip()]
    texts = [spoken(file) for file in SOURCES]
    assert any(all(part in text for part in parts) for text in texts), sentence


def test_every_flag_in_a_command_is_one() -> None:
    said = "".join(spoken(file) for file in SOURCES)
    for block in code(PAGE, "sh"):
        for flag in re.findall(r"--[a-z-]+", block):
            assert f'"{flag}"' in said, flag


def test_the_figures_are_those_in_force() -> None:
    logins = Logins()
    assert f"after {ABSOLUTE_S / 3600:g} hours, after {IDLE_S / 60:g} minutes" in PAGE
    for throttle, words in (
        (logins._limits.addresses, "from one address"),
        (logins._names, "for one name"),
    ):
        assert f"{throttle._free} {words}" in PAGE
    longest = (logins._limits.addresses._longest_s, logins._names._longest_s)
    assert "{:g} minutes for an address and {:g} for a name".format(*(s / 60 for s in longest)) in (
        " ".join(PAGE.split())
    )
    assert (
        f"after {logins._limits.together._at_once}, one in {logins._limits.together._every_s:g} s"
        in PAGE
    )


def test_the_limits_are_those_in_force() -> None:
    rows = tables(section(PAGE, "## How many, and how slow"))[0]
    limits = ConnectionLimits()
    assert limits.request_s == READ_S
    assert [row[1] for row in rows] == [
        f"{limits.unauthenticated}",
        f"{limits.per_address}",
        f"{limits.per_user}",
        *(
            f"{time_s:g} s"
            for time_s in (limits.handshake_s, limits.request_s, limits.idle_s, limits.stall_s)
        ),
    ]
