"""Source rules for the page in `web/`: size, tokens, and viser's internals."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

WEB = Path(__file__).parents[2] / "web"
GENERATED, TOKENS = WEB / "src/generated", WEB / "src/styles/tokens.css"
SOURCES = [
    path
    for folder in ("src", "frame")
    for path in sorted((WEB / folder).rglob("*"))
    if path.suffix in {".ts", ".tsx", ".css"} and GENERATED not in path.parents
]
MAX_LINES = 350
MAX_TOTAL_LINES, MAX_CSS_LINES = 12_000, 1500

_COMMENT = re.compile(r"/\*.*?\*/|(?<!:)//[^\n]*", re.DOTALL)
_NAMES = "white|black|red|green|blue|yellow|orange|purple|cyan|magenta|navy|teal|silver|gr[ae]y"
_COLOUR = re.compile(
    r"\b(?:rgba?|hsla?|hwb|(?:ok)?l(?:ab|ch))\(|"  # A function, except var() and color-mix().
    r"""["'`:\s(,]#(?:[0-9a-f]{3,4}|[0-9a-f]{6}|[0-9a-f]{8})\b(?!\w*[ ({.])|"""
    rf"""(?:colou?r|fill|stroke|background|border|outline|shadow)[\w-]*["']?\s*[:=]\s*"""
    rf"""(?:["'{{`][\w\s."'{{`]*?|[^;{{}}"'\n]*?\s|)\b(?:{_NAMES})\b(?![-(\w])""",
    re.IGNORECASE,
)
_FONT_SIZE = re.compile(
    r"""font-?size["']?\s*[:=]\s*["'{`]*[\d.]+(?:px|pt|rem|\b)|"""  # A declaration or attribute.
    r"""\bfont["']?\s*[:=][^;\n]*?\b[\d.]+(?:px|pt|rem)\b""",  # The short form, also of a canvas.
    re.IGNORECASE,
)
_INTERNALS = re.compile(
    r"mantine|__r3f|__react|_react\w*Container|\[class[*^~$|]?=|contentDocument|"
    r"contentWindow[?!]?\.(?:document|eval)",
    re.IGNORECASE,
)
_QUERY = re.compile(
    r"\b(?:querySelector(?!<HTMLCanvasElement>\(CANVAS\))(?:All)?|getElements?By\w+|closest|matches|"
    r"MutationObserver|shadowRoot)\b"
)


def violations(path: Path, pattern: re.Pattern[str]) -> list[str]:
    """Return place and text of each match outside comments."""
    name = path.relative_to(WEB)
    return [f"{name}:{line}: {text}" for line, text in found_in(path.read_text("utf-8"), pattern)]


def found_in(text: str, pattern: re.Pattern[str]) -> Iterator[tuple[int, str]]:
    code = _COMMENT.sub(lambda comment: "\n" * comment[0].count("\n"), text)
    for match in pattern.finditer(code):
        yield code.count("\n", 0, match.start()) + 1, match[0].strip()


def lines(path: Path) -> int:
    return len(path.read_text("utf-8").splitlines())


def colours(text: str) -> list[tuple[int, str]]:
    return list(found_in(text, _COLOUR))


def font_sizes(text: str) -> list[tuple[int, str]]:
    return list(found_in(text, _FONT_SIZE))


def internals(text: str) -> list[tuple[int, str]]:
    return list(found_in(text, _INTERNALS))


def queries(text: str) -> list[tuple[int, str]]:
    return list(found_in(text, _QUERY))


def test_no_module_of_the_page_is_longer_than_its_limit() -> None:
    assert {path.name: lines(path) for path in SOURCES if lines(path) > MAX_LINES} == {}


def test_the_page_is_not_longer_than_its_limits() -> None:
    assert TOKENS in SOURCES
    assert sum(map(lines, SOURCES)) <= MAX_TOTAL_LINES
    assert sum(lines(path) for path in SOURCES if path.suffix == ".css") <= MAX_CSS_LINES


@pytest.mark.parametrize("pattern", [_COLOUR, _FONT_SIZE], ids=["colour", "font size"])
def test_only_the_tokens_name_a_colour_or_a_font_size(pattern: re.Pattern[str]) -> None:
    assert violations(TOKENS, _COLOUR)
    assert [each for path in SOURCES if path != TOKENS for each in violations(path, pattern)] == []


def test_no_source_reaches_into_the_internals_of_viser() -> None:
    """The frame script runs in viser's page, where it may only look for the canvas."""
    assert [each for path in SOURCES for each in violations(path, _INTERNALS)] == []
    frame = [path for path in SOURCES if path.parent == WEB / "frame"]
    assert frame
    assert [each for path in frame for each in violations(path, _QUERY)] == []


@pytest.mark.parametrize(
    ("find", "text"),
    [
        (colours, ".a { color: #fff; }"),
        (colours, ".a { border: 1px solid #12ab34; }"),
        (colours, ".a { background: linear-gradient(#12ab3480, var(--bg)); }"),
        (colours, ".a { box-shadow: 0 1px 2px rgb(0 0 0 / .08); }"),
        (colours, ".a { color: white; }"),
        (colours, ".a { border: 1px solid black; }"),
        (colours, 'context.fillStyle = "#1d96fe";'),
        (colours, '<path fill="red" />'),
        (colours, "<path style={{ stroke: `oklch(0.7 0.1 ${hue})` }} />"),
        (font_sizes, ".a { font-size: 13px; }"),
        (font_sizes, ".a { font: 600 0.8rem/1 var(--font); }"),
        (font_sizes, 'context.font = "12px Inter";'),
        (font_sizes, '<text font-size="11">'),
        (font_sizes, "<p style={{ fontSize: 11 }}>"),
        (internals, 'frame.contentDocument.querySelector("canvas")'),
        (internals, ".mantine-Paper-root { display: none; }"),
        (internals, "div[class*=Panel] { display: none; }"),
        (queries, "document.querySelector(CANVAS)"),
        (queries, 'document.querySelector<HTMLDivElement>("#root")'),
        (queries, "document.querySelectorAll<HTMLCanvasElement>(CANVAS)"),
        (queries, 'document.getElementById("root")'),
    ],
)
def test_a_violation_is_found(find: Callable[[str], list[tuple[int, str]]], text: str) -> None:
    assert find(text)


@pytest.mark.parametrize(
    "text",
    [
        "/* like #fff, or 12px */ .a { color: var(--ink); font-size: var(--t-12); }",
        "#add { color: currentColor; background: transparent; }",
        ".a { color: color-mix(in srgb, var(--ink) 60%, transparent); width: 44px; }",
        "@media (forced-colors: active) { .a { border: 1px solid ButtonText; color: GrayText; } }",
        "class A { #bad = 1; read() { return this.#bad; } }",
        'const url = "https://example.org/#intro"; // Not white.',
        'const word = "the red robot"; const fill = count > 2;',
        "context.font = `${size}px ${family}`;",
        "frame.contentWindow?.postMessage(message, origin);",
    ],
)
def test_source_that_keeps_the_laws_passes(text: str) -> None:
    assert [*colours(text), *font_sizes(text), *internals(text)] == []


_RULE = re.compile(r"([^{}@;]+)\{")
_OWN = re.compile(r"\.([\w-]+)(?=$|[:.\[])")
SHARED = {"bar", "deck", "panel", "time", "phone-tabs", "shade", "btn", "js", "dot", "stop"}
"""Classes placed by the shell or extended by an area."""


def test_two_areas_do_not_style_the_same_class() -> None:
    """A rule without its area would restyle an element of another one."""
    areas: dict[str, set[str]] = {}
    for path in SOURCES:
        if path.suffix == ".css":
            for selectors in _RULE.findall(_COMMENT.sub("", path.read_text("utf-8"))):
                for selector in map(str.strip, selectors.split(",")):
                    found = _OWN.match(selector)
                    if found and not re.search(r"[ >+~]", selector):
                        areas.setdefault(found[1], set()).add(path.parent.name)
    assert {name for name, where in areas.items() if len(where) > 1} <= SHARED


def test_every_rule_of_the_styles_is_closed() -> None:
    for path in SOURCES:
        if path.suffix == ".css":
            text = _COMMENT.sub("", path.read_text("utf-8"))
            assert text.count("{") == text.count("}"), path
