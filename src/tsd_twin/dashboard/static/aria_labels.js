// Accessible names for viser's sliders and number fields: viser draws their labels beside them only.

const CONTROLS = "[role=slider], input[type=text]";
const NEAR = 8;

/** Give every control without a name the text of the label in its row. */
export function addAriaLabels() {
  for (const control of document.querySelectorAll(CONTROLS)) {
    // viser gives its sliders a name that is empty.
    const named = control.getAttribute("aria-label") || control.getAttribute("aria-labelledby");
    if (named || (control instanceof HTMLInputElement && control.labels?.length)) continue;
    const label = labelOf(control);
    if (label !== null) control.setAttribute("aria-label", label);
  }
}

/** @param {Element} control */
function labelOf(control) {
  let row = control.parentElement;
  for (let i = 0; i < NEAR && row !== null; i++, row = row.parentElement) {
    const text = row.querySelector("p")?.textContent.trim();
    if (text) return text;
  }
  return null;
}
