"""Specification of an emulated link: delay, jitter, loss, reordering, rate and stalls.

Malformed text and impossible numbers raise a `LinkError`.
"""

from __future__ import annotations

import difflib
import ipaddress
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from decimal import Decimal
from typing import Any, Self

from tsd_twin.errors import TwinError


class LinkError(TwinError):
    """Raised if a link specification is invalid or its endpoints cannot be used."""


_ENDPOINT = re.compile(
    r"(?P<protocol>tcp|udp)/(?P<host>\[[0-9A-Fa-f:.%]+\]|[^\[\]/:?#]+):(?P<port>\d{1,5})",
    re.ASCII,
)


@dataclass(frozen=True, slots=True)
class Endpoint:
    """Protocol (`tcp` or `udp`), host and port, in Zenoh's notation."""

    protocol: str
    host: str
    port: int

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{self.protocol}/{host}:{self.port}"

    @classmethod
    def parse(cls, text: str) -> Self:
        """Parse an endpoint such as `tcp/127.0.0.1:7447`."""
        match = _ENDPOINT.fullmatch(text.strip())
        if match is None or int(match["port"]) > 65535:
            raise LinkError(
                f"'{text}' is no endpoint of a link: write it as tcp/127.0.0.1:7447 "
                "or udp/127.0.0.1:7447"
            )
        return cls(match["protocol"], match["host"].strip("[]"), int(match["port"]))

    @property
    def is_loopback(self) -> bool:
        """Whether the host is a loopback address."""
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return self.host == "localhost"


_QUANTITY = re.compile(r"(?P<number>\d+(\.\d+)?)\s*(?P<unit>[A-Za-z%]*)", re.ASCII)


@dataclass(frozen=True, slots=True)
class Quantity:
    """Kind of quantity, written as a number and a unit.

    Reading and writing are exact: `parse(write(x)) == x` for every finite `x >= 0`.
    """

    kind: str
    """Name in error messages."""
    powers: Mapping[str, int]
    """Power of ten of each unit, smallest first."""
    example: str

    def parse(self, text: str) -> float:
        """Return the value in the base unit."""
        match = _QUANTITY.fullmatch(text.strip())
        if match is None or match["unit"] not in self.powers:
            units = ", ".join(self.powers)
            raise LinkError(
                f"'{text}' is no {self.kind}: write a number and one of {units}, "
                f"such as {self.example}"
            )
        return float(Decimal(match["number"]).scaleb(self.powers[match["unit"]]))

    def write(self, value: float) -> str:
        """Write the value in the largest unit that keeps it at 1 or more."""
        exact = Decimal(repr(float(value)))
        fitting = [unit for unit, power in self.powers.items() if exact >= Decimal(10) ** power]
        units = list(self.powers)
        unit = fitting[-1] if fitting else units[0 if exact else -1]
        return f"{exact.scaleb(-self.powers[unit]).normalize():f}{unit}"


TIME = Quantity("time", {"us": -6, "ms": -3, "s": 0}, "150ms")
SHARE = Quantity("share", {"%": -2}, "2%")
RATE = Quantity("rate", {"bit": 0, "kbit": 3, "Mbit": 6, "Gbit": 9}, "1Mbit")


SHORTEST_S = 0.001
"""Minimum length of a stall, and of the time between two; real time is not finer."""


@dataclass(frozen=True, slots=True)
class Stall:
    """Periodic pause of a link, which delays packets without losing them."""

    length_s: float
    period_s: float
    """Time between the starts of two stalls; the first starts after one period."""

    def __post_init__(self) -> None:
        between_s = self.period_s - self.length_s
        if not (self.length_s >= SHORTEST_S and SHORTEST_S <= between_s < math.inf):
            raise LinkError(
                f"a stall of {self.length_s:g} s every {self.period_s:g} s cannot be: "
                f"it must last {TIME.write(SHORTEST_S)} or more, and end that long before the next"
            )

    def __str__(self) -> str:
        return f"{TIME.write(self.length_s)}@{TIME.write(self.period_s)}"

    @classmethod
    def parse(cls, text: str) -> Self:
        """Parse a stall such as `2s@10s`."""
        length, at, period = text.partition("@")
        if not at:
            raise LinkError(f"'{text}' does not say how often: write it as 2s@10s")
        return cls(TIME.parse(length), TIME.parse(period))


@dataclass(frozen=True, slots=True)
class LinkSpec:
    """Link properties, equal in both directions; the default link is ideal.

    `str()` returns the text that `parse` reads, such as `delay=150ms,jitter=30ms,loss=2%`.
    """

    delay_s: float = 0.0
    """Minimum one-way delay."""
    jitter_s: float = 0.0
    """Mean (and standard deviation) of an exponential delay added to `delay_s`."""
    loss: float = 0.0
    """Fraction of packets lost independently, 0 to 1."""
    reorder: float = 0.0
    """Fraction of packets that take a detour and may be overtaken, 0 to 1."""
    stall: Stall | None = None
    bandwidth_bit_per_s: float = math.inf
    seed: int = 0
    """Random seed of the link."""

    def __post_init__(self) -> None:
        for name, value in (("delay", self.delay_s), ("jitter", self.jitter_s)):
            if not 0.0 <= value < math.inf:
                raise LinkError(f"{name} is {value:g} s, but must be finite and 0 s or more")
        for name, share in (("loss", self.loss), ("reorder", self.reorder)):
            if not 0.0 <= share <= 1.0:
                raise LinkError(f"{name} is {100.0 * share:g}%, but must be 0% to 100%")
        if not self.bandwidth_bit_per_s > 0.0:
            raise LinkError("bandwidth must be more than zero: leave it away for no limit")
        if self.seed < 0:
            raise LinkError(f"seed is {self.seed}, but must be 0 or more")

    def __str__(self) -> str:
        ideal = LinkSpec()
        words = [
            f"{name}={word.write(getattr(self, word.field))}"
            for name, word in _WORDS.items()
            if getattr(self, word.field) != getattr(ideal, word.field)
        ]
        return ",".join(words or ["delay=0s"])

    @classmethod
    def parse(cls, text: str) -> Self:
        """Parse a specification such as `delay=150ms,stall=2s@10s`."""
        fields: dict[str, Any] = {}
        for part in filter(None, (part.strip() for part in text.split(","))):
            name, _, value = (piece.strip() for piece in part.partition("="))
            word = _word(name)
            if not value:
                raise LinkError(f"'{part}' has no value: write it as {name}={word.example}")
            if word.field in fields:
                raise LinkError(f"'{name}' is given twice")
            try:
                fields[word.field] = word.parse(value)
            except LinkError as error:
                raise LinkError(f"{name}: {error}") from error
        return cls(**fields)


@dataclass(frozen=True, slots=True)
class _Word:
    field: str
    parse: Callable[[str], Any]
    write: Callable[[Any], str]
    example: str


def _whole(text: str) -> int:
    if not (text.isascii() and text.isdigit()):
        raise LinkError(f"'{text}' is no whole number, such as 7")
    return int(text)


_WORDS = {
    "delay": _Word("delay_s", TIME.parse, TIME.write, TIME.example),
    "jitter": _Word("jitter_s", TIME.parse, TIME.write, "30ms"),
    "loss": _Word("loss", SHARE.parse, SHARE.write, SHARE.example),
    "reorder": _Word("reorder", SHARE.parse, SHARE.write, SHARE.example),
    "stall": _Word("stall", Stall.parse, str, "2s@10s"),
    "bandwidth": _Word("bandwidth_bit_per_s", RATE.parse, RATE.write, RATE.example),
    "seed": _Word("seed", _whole, str, "7"),
}


def _word(name: str) -> _Word:
    if name in _WORDS:
        return _WORDS[name]
    close = difflib.get_close_matches(name, _WORDS, n=1)
    hint = f", did you mean '{close[0]}'?" if close else ";"
    raise LinkError(f"a link has no '{name}'{hint} valid are {', '.join(_WORDS)}")
