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
    assert f"after {ABSOLUTE_S / 3600:g} hours, after {IDLE_S / 60:g} minutes" in PAGE
    (tries, by_address_s), (others, by_name_s) = (
        limit_on("192.0.2.1", "x{}"),
        limit_on("192.0.2.{}", "alice"),
    )
    assert f"{tries} from one address" in PAGE
    assert f"{others} for one name" in PAGE
    longest = (by_address_s / 60, by_name_s / 60)
    assert "{:g} minutes for an address and {:g} for a name".format(*longest) in (
        " ".join(PAGE.split())
    )
    logins, tries = Logins(), 0
    while (wait_s := logins.wait_s(f"192.0.2.{tries}", f"x{tries}", 0.0)) == 0.0:
        tries += 1
    assert f"after {tries}, one in {wait_s:g} s" in PAGE


def limit_on(address: str, name: str) -> tuple[int, float]:
    """Return the free tries and the longest wait between later ones; `{}` is their number."""
    logins, now_s, waits_s, free = Logins(), 0.0, list[float](), 0
    for number in range(30):
        while (wait_s := logins.wait_s(address.format(number), name.format(number), now_s)) > 0.0:
            waits_s.append(round(wait_s, 3))
            now_s += wait_s
        free += not waits_s
    return free, max(waits_s)


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
