"""Pages that GitHub shows as well: navigation from the lists of the home page, links to source.

The home page lists all pages by section; its links become the navigation, so that the order is
written once. Links that lead out of `docs` go to the source on the web when `source_url` is set;
without it, their text stays.
"""

from __future__ import annotations

import re
from pathlib import Path

from sphinx.application import Sphinx
from sphinx.util.typing import ExtensionMetadata

_LINK = re.compile(r"\[((?:[^\[\]]|\[[^\]]*\])*)\]\((\.\./[^)\s]+)\)")
_FENCED = re.compile(r"(^```.*?^```$)", re.MULTILINE | re.DOTALL)
_LISTED = re.compile(r"^- \[[^\]]*\]\(([\w/]+)\.md\)", re.MULTILINE)
_REST = "More"
"""Caption of the pages that the home page does not list."""


def read(app: Sphinx, docname: str, source: list[str]) -> None:
    """Change the text of a page before it is parsed."""
    (text,) = source
    text = with_source_links(text, docname, app.config.source_url)
    if docname == app.config.root_doc:
        text += navigation(text, sorted(app.env.found_docs - {docname}))
    source[0] = text


def with_source_links(text: str, docname: str, source_url: str) -> str:
    """Lead links that leave `docs` to the source on the web, or leave their text alone."""
    depth = Path("docs", docname).parent

    def changed(link: re.Match[str]) -> str:
        label, target = link.groups()
        path, _, anchor = target.partition("#")
        parts: list[str] = []
        for part in (*depth.parts, *Path(path).parts):
            if part == "..":
                parts.pop()
            else:
                parts.append(part)
        if parts[0] == "docs":
            return link[0]
        url = "/".join((source_url.rstrip("/"), *parts)) + ("#" + anchor if anchor else "")
        return f"[{label}]({url})" if source_url else label

    blocks = _FENCED.split(text)
    blocks[::2] = [_LINK.sub(changed, prose) for prose in blocks[::2]]
    return "".join(blocks)


def navigation(text: str, pages: list[str]) -> str:
    """Return a hidden table of contents for each section of the home page that lists pages."""
    sections: dict[str, list[str]] = {}
    for section in re.split(r"^## ", text, flags=re.MULTILINE)[1:]:
        listed = _LISTED.findall(section)
        if listed:
            sections[section.splitlines()[0]] = listed
    placed = {page for listed in sections.values() for page in listed}
    rest = [page for page in pages if page not in placed]
    if rest:
        sections[_REST] = rest
    tables = (
        f"\n```{{toctree}}\n:hidden:\n:caption: {caption}\n\n" + "\n".join(listed) + "\n```\n"
        for caption, listed in sections.items()
    )
    return "\n" + "".join(tables)


def setup(app: Sphinx) -> ExtensionMetadata:
    """Register the setting and the change of pages."""
    app.add_config_value("source_url", "", "env", str)
    app.connect("source-read", read)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
