"""Command-line flags, and their types: numbers within a range, host names, web origins.

A type is a function for argparse's `type=`; invalid text causes a one-sentence error and exit
code 2.
"""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Callable
from typing import Any, TypeAlias

Container: TypeAlias = Any
"""Parser or argument group, for which argparse has no common public type."""


def add(
    to: Container,
    name: str,
    text: str,
    kind: Callable[[str], Any] | None = None,
    default: Any = None,
    metavar: str | None = None,
    *,
    repeated: bool = False,
    **more: Any,
) -> None:
    """Add a flag with a value, or a list of values if `repeated`; `more` is passed to argparse.

    The help is `text`, with the default and the repetition unless it mentions them.
    """
    if repeated:
        more["action"], default = "append", default or list[Any]()
        text += "" if "repeated" in text else "; may be repeated"
    if default not in (None, []) and "default" not in text:
        text += f"; default {default:g}" if isinstance(default, float) else f"; default {default}"
    to.add_argument(name, type=kind, default=default, metavar=metavar, help=text, **more)


def number(
    least: float = -math.inf, most: float = math.inf, *, above: float = -math.inf
) -> Callable[[str], float]:
    """Return the type of finite numbers from `least` to `most` that exceed `above`."""

    def parse(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not (math.isfinite(value) and least <= value <= most and value > above):
            raise argparse.ArgumentTypeError(_refusal(text, "a number", least, most, above))
        return value

    return parse


def whole(least: int, most: int | None = None) -> Callable[[str], int]:
    """Return the type of integers from `least` to `most`."""
    upper = math.inf if most is None else most

    def parse(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = None
        if value is None or not least <= value <= upper:
            raise argparse.ArgumentTypeError(_refusal(text, "a whole number", least, upper))
        return value

    return parse


PORT = whole(0, 65_535)
"""TCP or UDP port; 0 selects any free one."""
SEED = whole(0)
"""Random seed."""
SCALE = number(0.0)
"""Factor on standard deviations; 0 disables noise."""
POSITIVE = number(above=0.0)
"""Positive quantity."""


_HOST_NAME = re.compile(
    r"(?:[A-Za-z0-9](?:[A-Za-z0-9._-]*[A-Za-z0-9])?|\[[0-9A-Fa-f:.]+\])(?::[1-9]\d{0,4})?", re.ASCII
)


def host_name(text: str) -> str:
    """Return a host name or address with optional port, as sent by browsers.

    Raises:
        argparse.ArgumentTypeError: If the text has another form, such as a protocol or path.
    """
    if not _HOST_NAME.fullmatch(text):
        raise argparse.ArgumentTypeError(
            f"'{text}' is not a host: write it as robot.example or robot.example:8443"
        )
    return text


_DEFAULT_PORTS = {"http": ":80", "https": ":443"}


def web_origin(text: str) -> str:
    """Return a web origin as browsers send it: protocol and host, without the default port.

    Raises:
        argparse.ArgumentTypeError: If the text has another form, such as a path.
    """
    scheme, separator, host = text.lower().removesuffix("/").partition("://")
    if not separator or scheme not in _DEFAULT_PORTS or not _HOST_NAME.fullmatch(host):
        raise argparse.ArgumentTypeError(
            f"'{text}' is not an origin: write it as https://robot.example:8443"
        )
    return f"{scheme}://{host.removesuffix(_DEFAULT_PORTS[scheme])}"


def _refusal(text: str, kind: str, least: float, most: float, above: float = -math.inf) -> str:
    limits = [
        f"above {above:g}" if above > -math.inf else "",
        f"from {least:g} to {most:g}" if math.isfinite(least) and math.isfinite(most) else "",
        f"of {least:g} or more" if math.isfinite(least) and math.isinf(most) else "",
        f"of {most:g} or less" if math.isinf(least) and math.isfinite(most) else "",
    ]
    return f"'{text}' is not {' and '.join([kind, *filter(None, limits)]).replace(' and ', ' ', 1)}"
