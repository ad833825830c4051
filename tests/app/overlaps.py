"""Browser scripts that find overlapping, clipped and small elements."""

from __future__ import annotations

STILL = "*, *::before, *::after { pointer-events: auto !important; transition: none !important }"
"""Style that makes every element hit-testable, without transitions."""

_PAINTED = """
  const visible = (node) =>
    node.checkVisibility({ opacityProperty: true, visibilityProperty: true });
  const clear = (colour) => /^rgba?\\(.*(, 0|\\/ 0)\\)$|^transparent$/.test(colour);
  const inBox = ({ left, top, right, bottom }, x, y) =>
    left <= x && x <= right && top <= y && y <= bottom;
  const textsOf = (node) => [...node.childNodes]
    .filter(({ nodeType, data }) => nodeType === 3 && data.trim() !== "")
    .flatMap((text) => {
      const range = document.createRange();
      range.selectNodeContents(text);
      return [...range.getClientRects()];
    });
  const paints = (node, x, y) => {
    if (node.closest("svg") !== null) return node.tagName !== "svg";
    if (["IMG", "CANVAS", "IFRAME", "INPUT"].includes(node.tagName)) return true;
    const style = getComputedStyle(node);
    return !clear(style.backgroundColor) || textsOf(node).some((box) => inBox(box, x, y));
  };
  const short = (node) => node.outerHTML.slice(0, 90);
  /** What is painted on a target at a point; null if nothing is. */
  const cover = (target, x, y) => {
    for (const node of document.elementsFromPoint(x, y)) {
      if (target.contains(node) || node.contains(target)) return null;
      if (paints(node, x, y)) return node;
    }
    return null;
  };
  /** The part of a box that its ancestors do not scroll away or clip; a title has all of a text. */
  const clipped = (node, { left, top, right, bottom }) => {
    const box = { left, top, right, bottom, cut: false };
    for (let each = node; each !== null; each = each.parentElement) {
      const { overflowX, overflowY } = getComputedStyle(each);
      if (overflowX === "visible" && overflowY === "visible") continue;
      const outer = each.getBoundingClientRect();
      const scrolls = [overflowX, overflowY].some((way) => way === "auto" || way === "scroll");
      const exceeds = box.left < outer.left - 1 || box.right > outer.right + 1 ||
        box.top < outer.top - 1 || box.bottom > outer.bottom + 1;
      const isKnown = scrolls || each.closest("[title]") !== null;
      if (exceeds && !isKnown) box.cut = true;
      box.left = Math.max(box.left, outer.left);
      box.right = Math.min(box.right, outer.right);
      box.top = Math.max(box.top, outer.top);
      box.bottom = Math.min(box.bottom, outer.bottom);
      if (exceeds && isKnown) break;
    }
    return box;
  };
  const settle = () => new Promise((done) =>
    requestAnimationFrame(() => requestAnimationFrame(done)));
"""
STOP = (
    "async () => {"
    + _PAINTED
    + """
  await settle();
  const stop = document.querySelector(".stop, .stop-all");
  const { left, top, right, bottom } = stop.getBoundingClientRect();
  const covers = [];
  for (const x of [left + 8, (left + right) / 2, right - 8])
    for (const y of [top + 8, (top + bottom) / 2, bottom - 8]) {
      const above = cover(stop, x, y);
      if (above !== null) covers.push(short(above));
    }
  const isWhole = left >= 0 && top >= 0 && right <= innerWidth && bottom <= innerHeight;
  return { box: [left, top, right, bottom], covers, isWhole };
}"""
)
"""Place of STOP, and the elements that cover it."""

OVERLAPS = (
    "async (layers) => {"
    + _PAINTED
    + """
  await settle();
  const found = new Set();
  const look = (node, boxes) => {
    for (const whole of boxes) {
      const { cut, ...box } = clipped(node, whole);
      const isGone = box.right - box.left < 3 || box.bottom - box.top < 3;
      if (cut || whole.right > innerWidth + 1 || whole.left < -1 || whole.top < -1)
        found.add(`cut off: ${short(node)}`);
      if (isGone) continue;
      // Corners are round, and lines of text are lower than their boxes.
      const edge = node.matches("[role=application]")
        ? 0.15 * (box.right - box.left) : Math.min(5, (box.bottom - box.top) / 3);
      for (const x of [box.left + edge, (box.left + box.right) / 2, box.right - edge])
        for (const y of [box.top + edge, (box.top + box.bottom) / 2, box.bottom - edge]) {
          if (x < 0 || y < 0 || x >= innerWidth || y >= innerHeight) continue;
          const above = cover(node, x, y);
          if (above === null) continue;
          if (above.closest("svg") !== null && above.closest("svg") === node.closest("svg"))
            continue;
          const part = node.closest("[role=slider], .stop, .next");
          if (part !== null && part.contains(above)) continue;
          if (above.closest(layers) !== null && node.closest(layers) !== above.closest(layers))
            continue;
          found.add(`${short(above)} LIES ON ${short(node)}`);
        }
    }
  };
  const controls = "button, a[href], input, [role=slider], [role=application], [role=tab]";
  for (const node of document.querySelectorAll("body *")) {
    if (!visible(node) || node.closest(".sr") !== null) continue;
    const texts = textsOf(node);
    if (texts.length > 0) look(node, texts);
    if (node.matches(controls)) look(node, [node.getBoundingClientRect()]);
  }
  return [...found];
}"""
)
"""Texts and controls on which others lie, or which are cut off; layers may cover the page."""

FINE_PRINT = (
    "async () => {"
    + _PAINTED
    + """
  await settle();
  const sizeOf = (node) => {
    const size = parseFloat(getComputedStyle(node).fontSize);
    const matrix = node.getScreenCTM?.();
    return matrix ? size * Math.hypot(matrix.b, matrix.d) : size;
  };
  return [...document.querySelectorAll("body *")]
    .filter((node) => visible(node) && textsOf(node).length > 0 && sizeOf(node) < 11.9)
    .map((node) => `${sizeOf(node).toFixed(1)} px: ${short(node)}`);
}"""
)
"""Texts below 12 px, as they are drawn."""
