"""Snapshots in old recordings name classes by their former modules."""

from __future__ import annotations

import importlib
import importlib.util

import pytest

from tsd_twin.control import old_names


@pytest.mark.parametrize(("old", "name"), sorted(old_names._CLASSES))
def test_a_moved_class_is_defined_at_its_new_place(old: str, name: str) -> None:
    module, name = old_names.current(old, name)
    assert getattr(importlib.import_module(module), name).__module__ == module


@pytest.mark.parametrize("old", sorted(old_names._MODULES))
def test_a_renamed_module_is_found_under_its_new_name_only(old: str) -> None:
    new, _ = old_names.current(old, "other")
    assert importlib.util.find_spec(new)
    assert importlib.util.find_spec(old) is None


def test_other_names_stay() -> None:
    assert old_names.current("tsd_twin.lie", "SE2") == ("tsd_twin.lie", "SE2")
