// View settings: camera, layers and other options of the View tab. Keys 1 to 3 and presets change
// them, the server applies them, and the browser keeps them.

import { keep, recall } from "./memory.js";

const KEY = "tsd.view";
/** @type {Record<string, ViewSettings["camera"]>} */
const CAMERA_KEYS = { Digit1: "3-D", Digit2: "top", Digit3: "chase" };
const TRUE_POSES = ["when it differs", "always", "never"];
const TILTS = ["x1", "x3", "x10"];
/** As in scene/appearance.py. */
export const LAYERS = [
  ...["set-point", "true pose", "other estimate", "trail", "planned path", "thrust arrows"],
  ...["region of the pose", "predicted pose", "stop envelope", "labels"],
];
/** @type {ViewSettings} */
const USUAL = {
  camera: "3-D",
  follow: true,
  hidden: [],
  true_pose: "when it differs",
  tilt: "x1",
  dark: null,
};

export class ViewKeeper {
  /** @param {Link} link */
  constructor(link) {
    this._link = link;
    this._settings = kept();
    link.on("up", () => recall(KEY) !== null && this._send(false));
    link.on("view", ({ settings }) => this._keep(settings)); // Changed in the View tab.
  }

  /**
   * Change some settings; `look` points the camera at the robot.
   * @param {Partial<ViewSettings>} changes
   */
  change(changes, look = false) {
    this._keep({ ...this._settings, ...changes });
    this._send(look);
  }

  /** Handle a key event; return whether it was for the camera. @param {KeyboardEvent} event */
  key({ code, type, repeat }) {
    const camera = CAMERA_KEYS[code.replace("Numpad", "Digit")];
    if (camera === undefined) return false;
    if (type === "keydown" && !repeat) this.change({ camera }, true);
    return true;
  }

  /** @param {ViewSettings} settings */
  _keep(settings) {
    this._settings = settings;
    keep(KEY, JSON.stringify(settings));
  }

  /** @param {boolean} look */
  _send(look) {
    this._link.send({ t: "view", settings: this._settings, look });
  }
}

/** Return the stored settings known to this page. @returns {ViewSettings} */
function kept() {
  /** @type {Partial<ViewSettings>} */
  let read = {};
  try {
    read = JSON.parse(recall(KEY) ?? "{}") ?? {};
  } catch {
    // Not valid JSON.
  }
  const { camera, follow, hidden, true_pose, tilt, dark } = { ...USUAL, ...read };
  return {
    camera: Object.values(CAMERA_KEYS).includes(camera) ? camera : USUAL.camera,
    follow: follow !== false,
    hidden: LAYERS.filter((layer) => Array.isArray(hidden) && hidden.includes(layer)),
    true_pose: TRUE_POSES.includes(true_pose) ? true_pose : USUAL.true_pose,
    tilt: TILTS.includes(tilt) ? tilt : USUAL.tilt,
    dark: typeof dark === "boolean" ? dark : null,
  };
}
