// Messages between the page and the frame that shows viser's page. Both sides check the sender's
// origin and window. Types only, so that the frame's script shares no module with the page.

export interface FrameKey {
  tsd: 1;
  t: "key";
  code: string;
  key: string;
  down: boolean;
  repeat: boolean;
  mods: { ctrl: boolean; alt: boolean; shift: boolean; meta: boolean };
}

export type FromFrame =
  /** The frame's script runs, so its port can be reached; `software` draws without graphics card. */
  | { tsd: 1; t: "loaded"; software: boolean }
  | { tsd: 1; t: "drawn" }
  /** How long the frame's thread was blocked; for measurements. */
  | { tsd: 1; t: "stalled"; ms: number }
  | FrameKey
  | { tsd: 1; t: "pointerdown" };

/** Stop drawing, or resume. */
export type ToFrame = { tsd: 1; t: "pause"; on: boolean };
