"""What a simulated link does to what passes it, as text and as values."""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Self

from tsd_twin.linksim.errors import LinkError
from tsd_twin.linksim.quantity import RATE, SHARE, TIME

SHORTEST_S = 0.001
"""A stall, and the time between two, is no shorter: real time is not finer."""


@dataclass(frozen=True, slots=True)
class Stall:
    """A link that stands still again and again; nothing is lost, everything is late."""

    length_s: float
    period_s: float
    """From the start of one stall to that of the next; the first starts after one period."""

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
        """Return the stall of a text such as `2s@10s`.

        Raises:
            LinkError: it is written otherwise, or lasts as long as its period.
        """
        length, at, period = text.partition("@")
        if not at:
            raise LinkError(f"'{text}' does not say how often: write it as 2s@10s")
        return cls(TIME.parse(length), TIME.parse(period))


@dataclass(frozen=True, slots=True)
class LinkSpec:
    """What a link does to each packet, alike in both directions; the default does nothing.

    `str()` gives the text that `parse` reads, such as `delay=150ms,jitter=30ms,loss=2%`.
    """

    delay_s: float = 0.0
    """One way; no packet is faster."""
    jitter_s: float = 0.0
    """Standard deviation, and mean, of an exponential delay on top of `delay_s`."""
    loss: float = 0.0
    """Share of packets lost, each by its own chance, 0 to 1."""
    reorder: float = 0.0
    """Share of packets that take a detour and may be overtaken, 0 to 1."""
    stall: Stall | None = None
    bandwidth_bit_per_s: float = math.inf
    seed: int = 0
    """Of all chance in the link."""

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
        """Return the specification of a text such as `delay=150ms,stall=2s@10s`.

        Raises:
            LinkError: it names the word that is wrong, and what is valid.
        """
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
