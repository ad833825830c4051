import type { Texts } from "../text";

export const fleet: Texts["fleet"] = {};
