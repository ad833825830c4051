"""Scripts that measure in a browser whether texts are easy to see, and targets easy to hit."""

from __future__ import annotations

_SHOWN = """
  const isShown = (node) => {
    const { width, height } = node.getBoundingClientRect();
    const asked = { opacityProperty: true, visibilityProperty: true };
    return width > 1 && height > 1 && node.checkVisibility(asked);
  };
  const shown = () => [...document.querySelectorAll("body *")].filter(isShown);
"""
FAINT = (
    "() => {"
    + _SHOWN
    + """
  const pen = new OffscreenCanvas(1, 1).getContext("2d", { willReadFrequently: true });
  const known = new Map();
  const parse = (colour) => {
    if (!known.has(colour)) {
      pen.clearRect(0, 0, 1, 1);
      pen.fillStyle = colour;
      pen.fillRect(0, 0, 1, 1);
      const [r, g, b, a] = pen.getImageData(0, 0, 1, 1).data;
      known.set(colour, [r, g, b, a / 255]);
    }
    return known.get(colour);
  };
  const blend = ([r, g, b, a], under) => [r, g, b].map((part, i) => a * part + (1 - a) * under[i]);
  const light = (colour) => colour
    .map((part) => part / 255)
    .map((part) => (part <= 0.04045 ? part / 12.92 : ((part + 0.055) / 1.055) ** 2.4))
    .reduce((sum, part, i) => sum + [0.2126, 0.7152, 0.0722][i] * part, 0);
  const contrast = (one, other) => {
    const [low, high] = [light(one), light(other)].sort((a, b) => a - b);
    return (high + 0.05) / (low + 0.05);
  };
  const isText = (node) => node.matches("input:not([type=range], [type=checkbox])")
    ? (node.value || node.placeholder) !== ""
    : [...node.childNodes].some(({ nodeType, data }) => nodeType === 3 && data.trim() !== "");
  // A phone that is held sideways has its deck on the scene.
  const clear = (node) => node.matches(".scene-view") ||
    parse(getComputedStyle(node).backgroundColor)[3] === 0;
  const isDark = document.documentElement.dataset.theme === "dark";
  const scenes = isDark  // Floor, lines and robots.
    ? [[20, 22, 26], [60, 64, 70], [130, 134, 140]]
    : [[255, 255, 255], [130, 134, 140], [20, 22, 26]];
  const found = [];
  for (const node of shown().filter(isText)) {
    if (node.closest("svg") !== null) continue;  // On shapes, not on backgrounds.
    const layers = [];
    let opacity = 1;
    let isDisabled = false;
    let isOverScene = false;
    for (let each = node; each !== null && !isOverScene; each = each.parentElement) {
      const style = getComputedStyle(each);
      opacity *= Number(style.opacity);
      isDisabled ||= each.matches("[aria-disabled=true], :disabled, [data-disabled=true], option");
      layers.unshift(parse(style.backgroundColor));
      isOverScene = each.matches(".scene-view, .app > .deck") && clear(each);
    }
    if (isDisabled) continue;
    const { color, fontSize, fontWeight } = getComputedStyle(node);
    const size = parseFloat(fontSize);
    const least = size >= 24 || (size >= 18.66 && Number(fontWeight) >= 700) ? 3 : 4.5;
    const [r, g, b, a] = parse(color);
    for (const scene of isOverScene ? scenes : scenes.slice(0, 1)) {
      const ground = layers.reduce((under, layer) => blend(layer, under), scene);
      const figure = contrast(blend([r, g, b, a * opacity], ground), ground);
      if (figure < least)
        found.push(`${figure.toFixed(2)} on ${scene}: ${node.outerHTML.slice(0, 120)}`);
    }
  }
  return found;
}"""
)
"""Text with less contrast than 4.5 to 1, or 3 to 1 when it is large,
whatever of the scene is below it."""
SMALL = (
    "(least) => {"
    + _SHOWN
    + """
  const targets = "button, a[href], input:not([type=hidden]), select, textarea, summary, " +
    ["button", "tab", "slider", "checkbox", "radio", "combobox", "spinbutton", "option"]
      .map((role) => `[role=${role}]`).join();
  const isOption = (node) => node.matches("option");
  return shown()
    .filter((node) => node.matches(targets) && !isOption(node))
    .filter((node) => getComputedStyle(node).pointerEvents !== "none")
    .map((node) => {
      const boxes = [node, ...(node.labels ?? [])].map((each) => each.getBoundingClientRect());
      const more = getComputedStyle(node, "::after");
      const beyond = (side) => more.position === "absolute" && more.content !== "none"
        ? Math.min(32, Math.max(0, -parseFloat(more[side]))) : 0;
      const width = Math.max(...boxes.map(({ right }) => right)) + beyond("right") -
        Math.min(...boxes.map(({ left }) => left)) + beyond("left");
      const height = Math.max(...boxes.map(({ bottom }) => bottom)) + beyond("bottom") -
        Math.min(...boxes.map(({ top }) => top)) + beyond("top");
      return { node, width, height };
    })
    .filter(({ width, height }) => Math.min(width, height) < least - 0.5)
    .map(({ node, width, height }) =>
      `${width.toFixed(0)} x ${height.toFixed(0)}: ${node.outerHTML.slice(0, 120)}`);
}"""
)
"""Targets that are smaller than so many pixels, with their labels."""
