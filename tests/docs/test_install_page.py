"""The install page lists the extras of the package."""

from __future__ import annotations

import re
import tomllib

from packaging.requirements import Requirement

from tests.support.markdown_pages import ROOT, page, section, tables

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
EXTRAS: dict[str, list[str]] = PROJECT["optional-dependencies"]


def test_extras_on_the_page_are_those_of_the_package() -> None:
    (rows,) = tables(section(page("install.md"), "## Extras"))
    listed = {name.strip("`"): packages for name, _, packages in rows}
    assert set(listed) == set(EXTRAS)
    for name in set(EXTRAS) - {"all"}:
        requirements = [Requirement(text) for text in EXTRAS[name]]
        included = {extra for each in requirements for extra in each.extras}
        packages, _, of_others = listed[name].partition("the packages of")
        assert set(re.findall(r"`(\w+)`", of_others)) == included
        own = {each.name for each in requirements if each.name != "tsd-twin"}
        assert set(re.findall(r"[a-z\d][\w-]*", packages)) - {"and"} == own


def test_all_includes_every_extra() -> None:
    def included(name: str) -> set[str]:
        direct = {extra for text in EXTRAS[name] for extra in Requirement(text).extras}
        return {name}.union(*(included(extra) for extra in direct))

    assert included("all") == set(EXTRAS)
