"""Specification of an emulated link: delay, jitter, wander, loss, reordering, rate and stalls.

Malformed text and impossible numbers raise a `LinkError`.
"""

from __future__ import annotations

import difflib
import ipaddress
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
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


def _parse_periodic(text: str, example: str) -> tuple[float, float]:
    value, at, period = text.partition("@")
    if not at:
        raise LinkError(f"'{text}' does not say how often: write it as {example}")
    return TIME.parse(value), TIME.parse(period)


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
        return cls(*_parse_periodic(text, "2s@10s"))


@dataclass(frozen=True, slots=True)
class Wander:
    """Slow change of the delay, which is constant within a period."""

    most_s: float
    """Maximum additional delay; each period has a random part of it."""
    period_s: float

    def __post_init__(self) -> None:
        if not (0.0 <= self.most_s < math.inf and SHORTEST_S <= self.period_s < math.inf):
            raise LinkError(
                f"a delay cannot wander by {self.most_s:g} s every {self.period_s:g} s: "
                f"a period lasts {TIME.write(SHORTEST_S)} or more"
            )

    def __str__(self) -> str:
        return f"{TIME.write(self.most_s)}@{TIME.write(self.period_s)}"

    @classmethod
    def parse(cls, text: str) -> Self:
        """Parse a wander such as `10ms@15s`."""
        return cls(*_parse_periodic(text, "10ms@15s"))


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
    wander: Wander | None = None

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
    def parse(cls, text: str) -> LinkSpec:
        """Parse a specification such as `delay=150ms,stall=2s@10s`.

        It may begin with the name of a profile, whose properties those after it replace.
        """
        parts = list(filter(None, (part.strip() for part in text.split(","))))
        if parts and parts[0] in PROFILES:
            return replace(PROFILES[parts[0]].link, **cls._fields(parts[1:]))
        return cls(**cls._fields(parts))

    @staticmethod
    def _fields(parts: Sequence[str]) -> dict[str, Any]:
        fields: dict[str, Any] = {}
        for part in parts:
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
        return fields


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
    "wander": _Word("wander", Wander.parse, str, "10ms@15s"),
    "loss": _Word("loss", SHARE.parse, SHARE.write, SHARE.example),
    "reorder": _Word("reorder", SHARE.parse, SHARE.write, SHARE.example),
    "stall": _Word("stall", Stall.parse, str, "2s@10s"),
    "bandwidth": _Word("bandwidth_bit_per_s", RATE.parse, RATE.write, RATE.example),
    "seed": _Word("seed", _whole, str, "7"),
}


def _word(name: str) -> _Word:
    if name in _WORDS:
        return _WORDS[name]
    close = difflib.get_close_matches(name, [*_WORDS, *PROFILES], n=1)
    hint = f", did you mean '{close[0]}'?" if close else ";"
    raise LinkError(
        f"a link has no '{name}'{hint} valid are {', '.join(_WORDS)}, "
        f"or first a profile: {', '.join(PROFILES)}"
    )


@dataclass(frozen=True, slots=True)
class Profile:
    """Link by name."""

    link: LinkSpec
    source: str
    """Origin of its figures, and its assumptions."""


PROFILES = {
    "wifi": Profile(
        LinkSpec(delay_s=0.002, jitter_s=0.009, loss=0.005, stall=Stall(0.1, 1.0)),
        "busy access points of a campus: half of the round trips of the radio hop above 20 ms, a "
        "tenth above 100 ms (Pei et al., INFOCOM 2016); loss assumed",
    ),
    "4g": Profile(
        LinkSpec(
            delay_s=0.016,
            jitter_s=0.004,
            wander=Wander(0.007, 5.0),
            loss=0.001,
            stall=Stall(0.05, 20.0),
        ),
        "47 ms of round trip from a car (Testouri et al., 2025, arXiv:2503.14186), 50 ms of "
        "interruption by a handover (3GPP TR 36.881); their rate, wander and loss assumed",
    ),
    "satellite": Profile(
        LinkSpec(
            delay_s=0.011,
            jitter_s=0.002,
            wander=Wander(0.008, 15.0),
            loss=0.01,
            stall=Stall(0.14, 15.0),
        ),
        "Starlink: 33 ms of median round trip (its report of March 2024), new paths every 15 s "
        "with 140 ms of disturbance (arXiv:2601.08439); wander and loss assumed",
    ),
    "transatlantic": Profile(
        LinkSpec(delay_s=0.09, jitter_s=0.02, loss=0.01),
        "90 ms of round trip between New York and London are contracts of carriers (Verizon); "
        "the rest, jitter and loss are poor access on both sides, assumed",
    ),
}
"""Links to try driving over, by name."""
