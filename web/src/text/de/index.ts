import { bar } from "./bar";
import { deck } from "./deck";
import { panel } from "./panel";
import { scene } from "./scene";
import { plots } from "./plots";
import { health } from "./health";
import { timeline } from "./timeline";
import { fleet } from "./fleet";
import { student } from "./student";
import { common } from "./common";

import type { Texts } from "../text";

export const de: Texts = {
  common,
  bar,
  deck,
  panel,
  scene,
  plots,
  health,
  timeline,
  fleet,
  student,
};
