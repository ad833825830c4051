// Icons, drawn on 24 by 24; strokes take the colour of the text.

import type { CSSProperties } from "preact";

const SHAPES = {
  stopsign: '<path stroke="none" fill="currentColor" d="M8 2h8l6 6v8l-6 6H8l-6-6V8z"/>',
  play: '<path d="M7 5l12 7-12 7z"/>',
  ring: '<circle cx="12" cy="12" r="8"/>',
  full: '<circle cx="12" cy="12" r="8" fill="currentColor"/>',
  down: '<path d="M6 9l6 6 6-6"/>',
  ahead: '<path d="M4 12h15M13 6l6 6-6 6"/>',
  right: '<path d="M9 6l6 6-6 6"/>',
  fold: '<path d="M6 6l6 6-6 6M13 6l6 6-6 6"/>',
  gamepad:
    '<path d="M7 8h10a5 5 0 014.8 6.4l-.6 2a2.4 2.4 0 01-4.2.8L15 15H9l-2 2.200a2.4 2.4 0 01-4.2-.8l-.6-2A5 5 0 017 8z"/><path d="M8 10v3M6.5 11.500h3M15.5 11.500h.01M17.5 12.500h.01"/>',
  link: '<path d="M4 18v-3M9.3 18v-6M14.6 18V9M20 18V5"/>',
  battery: '<path d="M3 8h15v8H3zM21 11v2"/><path fill="currentColor" d="M5 10h9v4H5z"/>',
  grid: '<path d="M4 4h6v6H4zM14 4h6v6h-6zM4 14h6v6H4zM14 14h6v6h-6z"/>',
  home: '<path d="M4 11l8-7 8 7M6 10v9h12v-9"/>',
  help: '<circle cx="12" cy="12" r="9"/><path d="M9.5 9.500a2.5 2.5 0 113.6 2.200c-.8.4-1.1.9-1.1 1.800M12 16.500v.01"/>',
  warn: '<path d="M12 4L2.5 20h19zM12 10v4M12 17v.01"/>',
  ok: '<path d="M5 12.500l4.5 4.500L19 7.5"/>',
  search: '<circle cx="11" cy="11" r="6"/><path d="M15.5 15.500L20 20"/>',
  download: '<path d="M12 4v11M7 10.500l5 5 5-5M5 20h14"/>',
  share:
    '<path d="M9 12l6-4M9 12l6 4"/><circle cx="7" cy="12" r="2.5"/><circle cx="17" cy="7" r="2.5"/><circle cx="17" cy="17" r="2.5"/>',
  rename: '<path d="M4 20l1-4L16 5l3 3L8 19z"/>',
  close: '<path d="M6 6l12 12M18 6L6 18"/>',
  expand: '<path d="M14 4h6v6M20 4l-7 7M10 20H4v-6M4 20l7-7"/>',
  pause: '<path d="M8 5v14M16 5v14"/>',
  previous: '<path d="M18 6l-8 6 8 6zM6 6v12"/>',
  next: '<path d="M6 6l8 6-8 6zM18 6v12"/>',
  flag: '<path d="M6 21V4h11l-2 4 2 4H6"/>',
  more: '<path d="M5 12h.01M12 12h.01M19 12h.01"/>',
  plot: '<path d="M4 4v16h16M7 15l4-5 3 3 5-7"/>',
  wheel: '<circle cx="12" cy="12" r="8"/><path d="M12 12l4-5"/>',
  heart: '<path d="M3 12h4l2-5 4 10 2-5h6"/>',
  sliders:
    '<path d="M4 8h10M18 8h2M4 16h2M10 16h10"/><circle cx="16" cy="8" r="2"/><circle cx="8" cy="16" r="2"/>',
  half: '<circle cx="12" cy="12" r="8"/><path fill="currentColor" d="M12 4a8 8 0 010 16z"/>',
  map: '<path d="M4 6l5-2 6 2 5-2v14l-5 2-6-2-5 2zM9 4v14M15 6v14"/>',
  camera: '<path d="M4 8h4l2-3h4l2 3h4v11H4z"/><circle cx="12" cy="13" r="3.5"/>',
} as const;

export type IconName = keyof typeof SHAPES;

/** Icons of modes, and of the entries that replace an unknown mode. */
export const MODE_ICONS: Record<string, IconName> = {
  disarmed: "ring",
  arming: "half",
  ready: "full",
  driving: "play",
  stopping: "pause",
  stopped: "stopsign",
  fault: "warn",
  recorded: "previous",
  starting: "half",
  silent: "warn",
  offline: "warn",
};

export function Icon({ name, style }: { name: IconName; style?: CSSProperties }) {
  return (
    <svg
      class="i"
      viewBox="0 0 24 24"
      aria-hidden="true"
      style={style}
      dangerouslySetInnerHTML={{ __html: SHAPES[name] }}
    />
  );
}
