"""Layers of the page, in a real browser."""

from __future__ import annotations

import re
from collections.abc import Callable

import pytest
from playwright.sync_api import Browser, Page

from tests.support.browser import FEW_FRAMES, get_ready, mode
from tests.support.programs import Program
from tests.support.withheld import budget

pytestmark = [pytest.mark.system, pytest.mark.busy, pytest.mark.timeout(300)]

CHANGES = """() => new Promise((done) => {
  const counts = new Map();
  const observer = new MutationObserver((records) => {
    for (const { target } of records) {
      const node = target.nodeType === Node.ELEMENT_NODE ? target : target.parentElement;
      if (node) counts.set(node, (counts.get(node) ?? 0) + 1);
    }
  });
  observer.observe(document.body,
    { subtree: true, childList: true, characterData: true, attributes: true });
  const isOwn = (node) => {
    const { willChange, overflowY } = getComputedStyle(node);
    const scrolls = /auto|scroll/.test(overflowY) && node.scrollHeight > node.clientHeight;
    return willChange === "transform" || scrolls;
  };
  const hasOwn = (node) => node !== null && (isOwn(node) || hasOwn(node.parentElement));
  const isSeen = (node) => node.checkVisibility() && node.getBoundingClientRect().width > 1;
  setTimeout(() => {
    observer.disconnect();
    const often = [...counts].filter(([node, count]) => count > 15 && isSeen(node));
    const bare = often.filter(([node]) => !hasOwn(node));
    done([often.length, bare.map(([node, count]) => `${count} x ${node.outerHTML.slice(0, 90)}`)]);
  }, 2000);
})"""
"""Counts elements that change often within 2 s, and lists the ones without a layer."""
_SIZES = [(1440, 900), (390, 844), (844, 390)]
_TRIES = 5


@pytest.fixture(scope="module")
def page(start_shared: Callable[..., Program], browser: Browser) -> Page:
    """One demo and one page for all sizes."""
    ports = ("--port", "0", "--bus-port", "0")
    line = start_shared("tsd_demo", "--no-browser", "--no-record", "--until-eof", *ports)
    opened = browser.new_page()
    opened.add_init_script(FEW_FRAMES)
    opened.goto(re.findall(r"http://\S+", line.ready())[0])
    mode(opened, "disarmed")
    return opened


@pytest.mark.parametrize(("width", "height"), _SIZES)
def test_what_changes_with_each_state_of_a_driving_robot_has_a_layer_of_its_own(
    page: Page, width: int, height: int
) -> None:
    often, bare = 0, ["nothing measured"]
    for _ in budget.tries("drive", _TRIES):
        page.set_viewport_size({"width": 1280, "height": 720})
        get_ready(page)
        page.set_viewport_size({"width": width, "height": height})
        page.keyboard.down("w")
        try:
            often, bare = page.evaluate(CHANGES)
        finally:
            page.keyboard.up("w")
        if often:
            break
    assert often
    assert bare == []
