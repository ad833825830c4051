"""Formulas as MathML, made when the site is built: browsers show it without a script.

Few systems have a font with the tables of a formula: the site brings one.
"""

from __future__ import annotations

import re
import shutil
from importlib import resources

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.util.typing import ExtensionMetadata
from sphinx.writers.html5 import HTML5Translator

FONT = "STIXTwoMath-Regular.ttf"
"""STIX Two Math, under the SIL Open Font License."""

_FUNCTION = re.compile(r"(?<!sub>)(?<!sup>)(?<!under>)(<mi>[a-z]{2,}</mi>)(?=<mi>|<msu[bp])")
"""The name of a function before its argument, as in sin x."""
_SIGN = re.compile(r"(<mo[^>]*>(?:&#x00028;|&#x0002C;)</mo>(?:<mspace[^>]*>)?)<mo>(?=&#x02212;)")
"""A minus that begins a term."""


def mathml(latex: str, display: str) -> str:
    """Return a formula as MathML, with the gaps that TeX leaves."""
    made = _FUNCTION.sub(r'\1<mspace width="0.167em" />', convert(latex, display=display))
    return _SIGN.sub(r'\1<mo form="prefix">', made)


def visit_inline(translator: HTML5Translator, node: nodes.math) -> None:
    """Write a formula in a line of text."""
    translator.body.append(f'<span class="math">{mathml(node.astext(), "inline")}</span>')
    raise nodes.SkipNode


def visit_block(translator: HTML5Translator, node: nodes.math_block) -> None:
    """Write a display formula."""
    translator.body.append(f'<div class="math">{mathml(node.astext(), "block")}</div>')
    raise nodes.SkipNode


def copy_font(app: Sphinx, error: Exception | None) -> None:
    """Copy the font to the folder of its style sheet."""
    if error is None and app.builder.format == "html":
        font = resources.files("ziamath") / "fonts" / FONT
        with resources.as_file(font) as file:
            shutil.copy(file, app.outdir / "_static" / FONT)


def setup(app: Sphinx) -> ExtensionMetadata:
    """Register the renderer."""
    app.add_html_math_renderer("mathml", (visit_inline, None), (visit_block, None))
    app.connect("build-finished", copy_font)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
