import type { Texts } from "../text";

export const timeline: Texts["timeline"] = {};
