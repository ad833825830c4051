// How the scene looks on this page: camera, layers, exaggerated tilt, colours.

import { effect, signal } from "@preact/signals";
import { CAMERA_PRESETS, type ViewSettings } from "../generated/wire";
import type { Link } from "./link";
import { isOneOf, remembered } from "./memory";

type Settings = Required<ViewSettings>;

const INITIAL: Settings = {
  camera: "3-D",
  follow: true,
  hidden: [],
  true_pose: "when_different",
  tilt: "x5",
  dark: null,
};

function isView(stored: unknown): stored is Settings {
  const view = stored as Settings | null;
  return typeof view === "object" && view !== null && CAMERA_PRESETS.includes(view.camera);
}

/** Pixels of the scene: as many as the graphics card can draw, all, or half in each direction. */
export const SHARPNESS = ["auto", "full", "half"] as const;
export type Sharpness = (typeof SHARPNESS)[number];

export class View {
  readonly settings = remembered("tsd-view", INITIAL, isView);
  readonly sharpness = remembered<Sharpness>("tsd-sharpness", "auto", isOneOf(SHARPNESS));
  /** Whether dark colours are shown now. */
  readonly dark = signal(true);
  readonly #link: Link;

  constructor(link: Link) {
    this.#link = link;
    link.on("welcome", () => link.send({ t: "view", settings: this.settings.peek() }));
    const prefersDark = matchMedia("(prefers-color-scheme: dark)");
    const system = signal(prefersDark.matches);
    prefersDark.addEventListener("change", () => (system.value = prefersDark.matches));
    effect(() => {
      this.dark.value = this.settings.value.dark ?? system.value;
      document.documentElement.dataset["theme"] = this.dark.value ? "dark" : "light";
    });
  }

  /** Change settings; `look` turns the camera to the robot again. */
  set(change: Partial<Settings>, look = false): void {
    this.settings.value = { ...this.settings.peek(), ...change };
    this.#link.send({ t: "view", settings: this.settings.peek(), look });
  }
}
