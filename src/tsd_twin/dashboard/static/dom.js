// Creates and updates elements, and defines the icons.

/**
 * Create an element from a selector (`div.head`), attributes and children. Attributes named `on…`
 * are listeners; false and null are skipped.
 * @template {keyof HTMLElementTagNameMap} K
 * @param {K | `${K}.${string}`} selector @param {Content[]} content
 * @returns {HTMLElementTagNameMap[K]}
 */
export function el(selector, ...content) {
  const [tag, ...classes] = selector.split(".");
  return fill(document.createElement(/** @type {K} */ (tag)), classes, content);
}

/**
 * Like `el`, in the SVG namespace.
 * @template {keyof SVGElementTagNameMap} K
 * @param {K | `${K}.${string}`} selector @param {Content[]} content
 * @returns {SVGElementTagNameMap[K]}
 */
export function svg(selector, ...content) {
  const [tag, ...classes] = selector.split(".");
  const node = document.createElementNS("http://www.w3.org/2000/svg", /** @type {K} */ (tag));
  return fill(node, classes, content);
}

/**
 * @template {Element} E
 * @param {E} node @param {string[]} classes @param {Content[]} content
 */
function fill(node, classes, content) {
  if (classes.length > 0) node.classList.add(...classes);
  for (const item of content) {
    if (typeof item === "string" || item instanceof Node) node.append(item);
    else for (const [name, value] of Object.entries(item ?? {})) assign(node, name, value);
  }
  return node;
}

/** @param {Element} node @param {string} name @param {Attributes[string]} value */
function assign(node, name, value) {
  if (typeof value === "function")
    node.addEventListener(name.slice(2), /** @type {EventListener} */ (value));
  else if (value === true) node.setAttribute(name, "");
  else if (value !== false && value !== null && value !== undefined)
    node.setAttribute(name, String(value));
}

/** Set a text only if it changes, which is rare. @param {Element} node @param {string} text */
export function setText(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

/** @param {Element} node @param {string} name @param {string | number | null} value */
export function setAttribute(node, name, value) {
  if (value === null) node.removeAttribute(name);
  else if (node.getAttribute(name) !== String(value)) node.setAttribute(name, String(value));
}

/**
 * Return a legend for setpoints and measured values.
 * @param {string} mark Class of the mark of a set-point. @param {string} note
 */
export function legend(mark, note) {
  const marks = [el(`i.${mark}`), "set-point", el("i.dot"), "measured"];
  return el("p.key", ...marks, el("span.muted", note));
}

/** Return an icon in a 16-unit square. @param {string} name */
export function icon(name) {
  return svg(
    "svg.icon",
    { viewBox: "0 0 16 16", "aria-hidden": "true" },
    ...(ICONS[name] ?? []).map(([tag, attributes]) => svg(tag, attributes)),
  );
}

const LINE = {
  fill: "none",
  stroke: "currentColor",
  "stroke-width": 1.75,
  "stroke-linecap": "round",
  "stroke-linejoin": "round",
};
const SOLID = { fill: "currentColor" };

// A distinct shape for each mode, so that colour is not the only cue.
/** @type {Record<string, [keyof SVGElementTagNameMap, Attributes][]>} */
const ICONS = {
  disarmed: [["circle", { cx: 8, cy: 8, r: 5.5, ...LINE }]],
  arming: [
    ["circle", { cx: 8, cy: 8, r: 5.5, ...LINE, "stroke-dasharray": "2.6 3.16" }],
    ["circle", { cx: 8, cy: 8, r: 2, ...SOLID }],
  ],
  ready: [["circle", { cx: 8, cy: 8, r: 6, ...SOLID }]],
  driving: [
    [
      "path",
      { d: "M4 2.5 14 8 4 13.5Z", ...SOLID, stroke: "currentColor", "stroke-linejoin": "round" },
    ],
  ],
  stopping: [["path", { d: "M3 3.5 8 8.5 13 3.5M3 8.5 8 13.5 13 8.5", ...LINE }]],
  stopped: [["path", { d: "M5.2 1h5.6L15 5.2v5.6L10.8 15H5.2L1 10.8V5.2Z", ...SOLID }]],
  fault: [
    ["path", { d: "M8 1.5 15 14H1Z", ...LINE }],
    ["path", { d: "M8 6v4M8 12v.1", ...LINE }],
  ],
  good: [["circle", { cx: 8, cy: 8, r: 5, ...SOLID }]],
  fair: [
    ["circle", { cx: 8, cy: 8, r: 4.5, ...LINE }],
    ["path", { d: "M8 3.5a4.5 4.5 0 0 0 0 9Z", ...SOLID }],
  ],
  poor: [["circle", { cx: 8, cy: 8, r: 4.5, ...LINE }]],
  none: [["path", { d: "M4 4l8 8M12 4l-8 8", ...LINE }]],
  battery: [
    ["path", { d: "M1.5 5h11v6h-11ZM14.5 7v2", ...LINE }],
    ["path", { d: "M3.5 7h5v2h-5Z", ...SOLID }],
  ],
  ask: [
    ["circle", { cx: 5, cy: 5, r: 2.5, ...LINE }],
    ["path", { d: "M1 13.5c0-3 1.6-4.5 4-4.5 1.2 0 2.2.4 2.9 1.1", ...LINE }],
    ["path", { d: "M9.5 12.5H15M12.5 9.8l2.7 2.7-2.7 2.7", ...LINE }],
  ],
  plus: [["path", { d: "M8 3v10M3 8h10", ...LINE }]],
  minus: [["path", { d: "M3 8h10", ...LINE }]],
  tick: [["path", { d: "M3 8.5 6.5 12 13 4.5", ...LINE }]],
  play: [["path", { d: "M4 2.5 13 8 4 13.5Z", ...SOLID }]],
  pause: [["path", { d: "M5 3v10M11 3v10", ...LINE, "stroke-width": 3 }]],
  previous: [["path", { d: "M13 3 6 8 13 13ZM3 3v10", ...LINE, fill: "currentColor" }]],
  next: [["path", { d: "M3 3 10 8 3 13ZM13 3v10", ...LINE, fill: "currentColor" }]],
  mark: [["path", { d: "M8 2 13 8 8 14 3 8Z", ...SOLID }]],
  more: [["path", { d: "M3 8v.1M8 8v.1M13 8v.1", ...LINE, "stroke-width": 3 }]],
  close: [["path", { d: "M4 4l8 8M12 4l-8 8", ...LINE }]],
};

/** Whether an element is visible; elements in hidden tabs have no size. @param {Element} node */
export function isVisible(node) {
  return (
    document.visibilityState === "visible" &&
    /** @type {HTMLElement} */ (node).offsetParent !== null
  );
}
