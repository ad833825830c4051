"""Examples of reasons: any values of the right types, and one fixed set for both formatters."""

from __future__ import annotations

from collections.abc import Iterator

from hypothesis import strategies as st

from tsd_twin.messages.codes import DECIMALS, PARAMETERS, Code, Reason, Type, Value, because
from tsd_twin.messages.sentences import WORDS

_IDS = st.from_regex(r"[a-z0-9_-]{1,32}", fullmatch=True)
_TEXTS = st.text(st.characters(exclude_characters="[]{}|", codec="utf-8"), min_size=1).filter(
    lambda text: "None" not in text
)


@st.composite
def example_reasons(draw: st.DrawFn, depth: int = 2) -> Reason:
    """Reasons with any values of the types of their parameters."""
    codes = [code for code in Code if depth or Type.CAUSE not in PARAMETERS[code].values()]
    code = draw(st.sampled_from(codes))
    params: dict[str, Value] = {}
    cause = None
    for name, kind in PARAMETERS[code].items():
        if name.endswith("?") and (not depth or draw(st.booleans())):
            continue
        if kind is Type.CAUSE:
            cause = draw(example_reasons(depth - 1))
        else:
            params[name.removesuffix("?")] = draw(_values(kind))
    return because(code, cause, **params)


def _values(kind: Type) -> st.SearchStrategy[Value]:
    if kind in DECIMALS:
        return st.floats(-1e6, 1e6) | st.integers(-(10**6), 10**6)
    if kind in WORDS and kind is not Type.SERVOS:
        return st.sampled_from(sorted(WORDS[kind]))
    return _TEXTS if kind is Type.TEXT else _IDS


_NUMBERS = (0, 5, -12.5, 1234.75, 0.04, 100000)


def fixed_reasons() -> Iterator[Reason]:
    """One reason of each code and a few of each kind of number, always the same."""
    for number, code in enumerate(Code):
        yield _fixed(code, number, with_optional=True)
        if any(name.endswith("?") for name in PARAMETERS[code]):
            yield _fixed(code, number, with_optional=False)
    yield Reason("wheel_came_off", {"wheel": "left"})
    yield Reason("board_trip", {"trip": "meteor_strike"})
    yield Reason("held_by", {})


def _fixed(code: Code, number: int, *, with_optional: bool) -> Reason:
    params: dict[str, Value] = {}
    cause = None
    for name, kind in PARAMETERS[code].items():
        number += 1
        if name.endswith("?") and not with_optional:
            continue
        if kind is Type.CAUSE:
            cause = because(Code.LEASE_EXPIRED, operator="web-8c30fedb")
        elif kind in DECIMALS:
            params[name.removesuffix("?")] = _NUMBERS[number % len(_NUMBERS)]
        elif kind is Type.SERVOS:
            several = number % 2
            other = ", 5 (module3_alpha)" if several else ""
            params[name.removesuffix("?")] = f"3 (module2_alpha){other}"
        elif kind in WORDS:
            words = sorted(WORDS[kind])
            params[name.removesuffix("?")] = words[number % len(words)]
        elif kind is Type.OPERATOR:
            params[name.removesuffix("?")] = ("alice-0123abcd", "web-8c30fedb", "bob")[number % 3]
        else:
            params[name.removesuffix("?")] = "some text: with a colon"
    return because(code, cause, **params)
