import type { Texts } from "../text";

export const student: Texts["student"] = {};
