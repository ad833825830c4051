import type { Texts } from "../text";

export const deck: Texts["deck"] = {};
