import type { Texts } from "../text";

export const scene: Texts["scene"] = {};
