"""`import tsd_twin` exports exactly the names in its `__all__`."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import tsd_twin
from tsd_twin import __all__, client


@pytest.mark.parametrize("name", __all__)
def test_every_name_can_be_had_and_is_documented(name: str) -> None:
    value = getattr(tsd_twin, name)
    assert name in dir(tsd_twin)
    assert name == "__version__" or value.__doc__


def test_a_type_checker_sees_the_names_that_there_are() -> None:
    tree = ast.parse(Path(tsd_twin.__file__).read_text(encoding="utf-8"))
    (guard,) = [node for node in tree.body if isinstance(node, ast.If)]
    seen = {
        alias.asname or alias.name
        for node in guard.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert seen | {"__version__"} == set(__all__)


def test_the_client_offers_what_it_names() -> None:
    assert all(hasattr(client, name) for name in client.__all__)
    assert client.__all__ == sorted(client.__all__, key=lambda name: (name[0].islower(), name))


def test_another_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'conect'"):
        _ = tsd_twin.conect
