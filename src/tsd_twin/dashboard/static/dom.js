// Making elements.
/**
 * Return an element; `on…` attributes are listeners, false and null ones are left out.
 * @template {keyof HTMLElementTagNameMap} K
 * @param {K} tag
 * @param {Attributes} [attributes]
 * @param {(Node | string | null)[]} children
 */
export function el(tag, attributes = {}, ...children) {
  return fill(document.createElement(tag), attributes, children);
}

/**
 * As `el`, in the SVG namespace.
 * @template {keyof SVGElementTagNameMap} K
 * @param {K} tag
 * @param {Attributes} [attributes]
 * @param {(Node | string | null)[]} children
 */
export function svg(tag, attributes = {}, ...children) {
  return fill(document.createElementNS("http://www.w3.org/2000/svg", tag), attributes, children);
}

/**
 * @template {Element} E
 * @param {E} node
 * @param {Attributes} attributes
 * @param {(Node | string | null)[]} children
 */
function fill(node, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (value === false || value === null || value === undefined) continue;
    if (typeof value === "function")
      node.addEventListener(name.slice(2), /** @type {EventListener} */ (value));
    else node.setAttribute(name, value === true ? "" : String(value));
  }
  node.append(...children.filter((child) => child !== null));
  return node;
}

/**
 * Set the text of a node if it is another one: twenty times a second, most of it is not.
 * @param {Element} node
 * @param {string} text
 */
export function setText(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

/**
 * Set an attribute if its value is another one; null takes it away.
 * @param {Element} node
 * @param {string} name
 * @param {string | number | null} value
 */
export function setAttribute(node, name, value) {
  if (value === null) node.removeAttribute(name);
  else if (node.getAttribute(name) !== String(value)) node.setAttribute(name, String(value));
}

/** Return an icon drawn in a square of 16 units. @param {string} name */
export function icon(name) {
  return svg(
    "svg",
    { class: "icon", viewBox: "0 0 16 16", "aria-hidden": "true" },
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

// One shape for each mode, so that none is told by its colour alone.
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
  unknown: [["path", { d: "M5.5 6a2.5 2.5 0 1 1 3.6 2.2c-.8.4-1.1.9-1.1 1.8M8 13v.1", ...LINE }]],
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
  fold: [["path", { d: "M3 10l5-5 5 5", ...LINE }]],
  chevron: [["path", { d: "M4 6l4 4 4-4", ...LINE }]],
  close: [["path", { d: "M4 4l8 8M12 4l-8 8", ...LINE }]],
};

// Visibility of elements.
/** Whether an element can be seen now: a tab that is not shown takes no room. @param {Element} node */
export function isVisible(node) {
  return (
    document.visibilityState === "visible" &&
    /** @type {HTMLElement} */ (node).offsetParent !== null
  );
}
