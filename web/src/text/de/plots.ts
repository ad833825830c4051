import type { Texts } from "../text";

export const plots: Texts["plots"] = {};
