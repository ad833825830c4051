"""Sensors, one module each: table, noise, simulation, measurement model and telemetry."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Mapping, Sequence
from functools import cache
from importlib import metadata
from typing import Any, cast

import msgspec

from tsd_twin.registry import KindError
from tsd_twin.sensors.base import MountedSensor, Sensor, SensorTable
from tsd_twin.tables import table_problem

GROUP = "tsd_twin.sensors"
"""Entry-point group of sensors in other packages."""


def kinds() -> list[str]:
    """Return the kinds of `[[sensors]]` that are installed, sorted."""
    own = [module.name for module in pkgutil.iter_modules(__path__) if module.name != "base"]
    return sorted({*filter(_is_entry, own), *(point.name for point in _entry_points())})


@cache
def find(kind: str) -> tuple[Sensor[Any], type[SensorTable]]:
    """Return a kind of sensor for `[[sensors]]`, and the class of its table.

    `tsd_twin.sensors.<kind>` has precedence over entry points.

    Raises:
        KindError: If no module or package provides it.
    """
    if not kind.isidentifier() or kind not in kinds():
        raise KindError(f"there is no sensor '{kind}' (sensors are {', '.join(kinds()) or 'none'})")
    if any(module.name == kind for module in pkgutil.iter_modules(__path__)):
        found: Any = importlib.import_module(f"{__name__}.{kind}")
    else:
        (point,) = (point for point in _entry_points() if point.name == kind)
        found = point.load()
    return found.SENSOR, found.TABLE


def read_tables(entries: Any) -> tuple[SensorTable, ...]:
    """Convert the entries of `[[sensors]]`; entries that are tables already stay.

    Raises:
        ValueError: If a key is unknown, missing or impossible; the message names it.
    """
    if not isinstance(entries, list | tuple):
        raise ValueError("sensors is no list of tables: write [[sensors]]")
    listed = cast(Sequence[Any], entries)
    tables = tuple(_read(entry, f"sensors[{i}]") for i, entry in enumerate(listed))
    names = [table.name for table in tables]
    if len(set(names)) < len(names):
        raise ValueError(f"two sensors have the same name: {', '.join(names)}")
    return tables


def mounted(table: SensorTable) -> MountedSensor:
    """Return the sensor of an entry of `[[sensors]]`."""
    return find(str(table.__struct_config__.tag))[0], table


def _read(entry: Any, path: str) -> SensorTable:
    if isinstance(entry, SensorTable):
        return entry
    if not isinstance(entry, Mapping) or "kind" not in entry:
        raise ValueError(f"{path}: key 'kind' is missing (sensors are {', '.join(kinds())})")
    values = dict(cast(Mapping[str, Any], entry))
    try:
        _, cls = find(str(values["kind"]))
    except KindError as error:
        raise ValueError(f"{path}: {error}") from error
    problem = table_problem(values, cls, path)
    if problem is not None:
        raise ValueError(" ".join(filter(None, (problem[0], problem[1] and f"({problem[1]})"))))
    return msgspec.convert(values, cls)


@cache
def _entry_points() -> tuple[metadata.EntryPoint, ...]:
    return tuple(metadata.entry_points(group=GROUP))


def _is_entry(kind: str) -> bool:
    """Return whether a module of this package is a kind of `[[sensors]]`."""
    return hasattr(importlib.import_module(f"{__name__}.{kind}"), "TABLE")
