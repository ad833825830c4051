import type { Texts } from "../text";

export const health: Texts["health"] = {};
