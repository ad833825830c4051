// How the scene looks on this page: camera, layers, exaggerated tilt, colours.

import { computed, effect } from "@preact/signals";
import type { ViewSettings } from "../generated/wire";
import { CAMERA_PRESETS, LAYERS, TILT_FACTORS, TRUE_POSE_DISPLAYS } from "../generated/wire";
import { media } from "./layout";
import type { Link } from "./link";
import { isObject, isOneOf, remembered } from "./memory";

type Settings = Required<ViewSettings>;

const INITIAL: Settings = {
  camera: "3-D",
  follow: true,
  hidden: [],
  true_pose: "when_different",
  tilt: "x5",
  floor_camera: false,
  dark: null,
};

/** Replace what this page does not know, because another version of it has kept the settings. */
function known(stored: Partial<Settings>): Settings {
  const { camera, follow, hidden, true_pose, tilt, floor_camera, dark } = { ...INITIAL, ...stored };
  return {
    camera: CAMERA_PRESETS.includes(camera) ? camera : INITIAL.camera,
    follow: follow !== false,
    hidden: LAYERS.filter((layer) => Array.isArray(hidden) && hidden.includes(layer)),
    true_pose: TRUE_POSE_DISPLAYS.includes(true_pose) ? true_pose : INITIAL.true_pose,
    tilt: TILT_FACTORS.includes(tilt) ? tilt : INITIAL.tilt,
    floor_camera: floor_camera === true,
    dark: typeof dark === "boolean" ? dark : null,
  };
}

/** Pixels of the scene: as many as the graphics card can draw, all, or half in each direction. */
export const SHARPNESS = ["auto", "full", "half"] as const;
export type Sharpness = (typeof SHARPNESS)[number];

export class View {
  readonly settings = remembered("tsd-view", INITIAL, isObject<Settings>);
  readonly sharpness = remembered<Sharpness>("tsd-sharpness", "auto", isOneOf(SHARPNESS));
  readonly #prefersDark = media("(prefers-color-scheme: dark)");
  readonly dark = computed(() => this.settings.value.dark ?? this.#prefersDark.value);

  constructor(private readonly link: Link) {
    this.settings.value = known(this.settings.peek());
    link.on("welcome", () => link.send({ t: "view", settings: this.settings.peek() }));
    effect(() => {
      document.documentElement.dataset["theme"] = this.dark.value ? "dark" : "light";
    });
  }

  /** Change settings; `look` turns the camera to the robot again. */
  set(change: Partial<Settings>, look = false): void {
    this.settings.value = { ...this.settings.peek(), ...change };
    this.link.send({ t: "view", settings: this.settings.peek(), look });
  }
}
