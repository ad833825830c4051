// How the scene looks on this page: camera, layers, exaggerated tilt, colours.

import { computed, effect } from "@preact/signals";
import { CAMERA_PRESETS, type ViewSettings } from "../generated/wire";
import { media } from "./layout";
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
  return CAMERA_PRESETS.includes((stored as Settings | null)?.camera as Settings["camera"]);
}

/** Pixels of the scene: as many as the graphics card can draw, all, or half in each direction. */
export const SHARPNESS = ["auto", "full", "half"] as const;
export type Sharpness = (typeof SHARPNESS)[number];

export class View {
  readonly settings = remembered("tsd-view", INITIAL, isView);
  readonly sharpness = remembered<Sharpness>("tsd-sharpness", "auto", isOneOf(SHARPNESS));
  readonly #prefersDark = media("(prefers-color-scheme: dark)");
  /** Whether dark colours are shown now. */
  readonly dark = computed(() => this.settings.value.dark ?? this.#prefersDark.value);

  constructor(private readonly link: Link) {
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
