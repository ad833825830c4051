import type { Texts } from "../text";

export const panel: Texts["panel"] = {};
