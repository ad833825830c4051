import type { Texts } from "../text";

export const bar: Texts["bar"] = {};
