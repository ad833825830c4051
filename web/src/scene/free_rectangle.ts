// The part of the picture that nothing covers. The dashboard frames the robot in it.

/** Edges in pixels or fractions, to the right and down. */
export type Box = Pick<DOMRect, "left" | "top" | "right" | "bottom">;

/** Takes fractions of the picture, and its height in pixels. */
export type Report = (free: Box, height: number) => void;

const LEAST_SHARE = 0.4; // With less room, as under a large map, the robot stays in the middle.
const ROBOT_ASPECT = 1.6; // Typical ratio of width and height of a robot in the picture.
const ROOM = 1.25; // Least length of the longer side, relative to what the robot needs.
const MIDDLE_SHARE = 0.1; // Size that is given up for a place nearer to the middle, per distance.

/**
 * Return the rectangle of a picture, in fractions, that no cover touches and in which a robot is
 * largest and nearest to the middle. Without room, it is the whole picture.
 */
export function freeRectangle(picture: Box, covers: readonly Box[]): Box {
  const size = (box: Box) => Math.min((box.right - box.left) / ROBOT_ASPECT, box.bottom - box.top);
  const [x, y] = [0.5 * (picture.left + picture.right), 0.5 * (picture.top + picture.bottom)];
  const centred = (box: Box) => {
    const height = (ROOM * (box.right - box.left)) / ROBOT_ASPECT;
    const width = ROOM * ROBOT_ASPECT * (box.bottom - box.top);
    const [left, right] = towards(x, box.left, box.right, width);
    const [top, bottom] = towards(y, box.top, box.bottom, height);
    return { left, top, right, bottom };
  };
  const value = (box: Box) => {
    const { left, top, right, bottom } = centred(box);
    const away = Math.hypot(0.5 * (left + right) - x, 0.5 * (top + bottom) - y);
    return size(box) - MIDDLE_SHARE * away;
  };
  const { left, top, right, bottom } = picture;
  const over = covers
    .filter((cover) => overlap(cover, picture))
    .map((cover) => ({
      left: Math.max(left, cover.left),
      top: Math.max(top, cover.top),
      right: Math.min(right, cover.right),
      bottom: Math.min(bottom, cover.bottom),
    }));
  const lefts = [left, ...over.map((cover) => cover.right)];
  const rights = [right, ...over.map((cover) => cover.left)];
  const tops = [top, ...over.map((cover) => cover.bottom)];
  const bottoms = [bottom, ...over.map((cover) => cover.top)];
  let [free, best] = [picture, -Infinity];
  for (const l of lefts)
    for (const r of rights)
      for (const t of tops)
        for (const b of bottoms) {
          const box = { left: l, top: t, right: r, bottom: b };
          const found = l < r && t < b ? value(box) : -Infinity;
          if (found > best && !over.some((cover) => overlap(cover, box)))
            [free, best] = [box, found];
        }
  free = size(free) < LEAST_SHARE * size(picture) ? picture : centred(free);
  const share = (part: number, whole: number) => Math.round((1000 * part) / whole) / 1000;
  return {
    left: share(free.left - left, right - left),
    top: share(free.top - top, bottom - top),
    right: share(free.right - left, right - left),
    bottom: share(free.bottom - top, bottom - top),
  };
}

/** Cut an interval so that its centre is near `middle`; a length of `least` remains. */
function towards(middle: number, from: number, to: number, least: number): [number, number] {
  const room = Math.max(0.5 * least, Math.min(middle - from, to - middle));
  const half = Math.min(0.5 * (to - from), room);
  const centre = Math.max(from + half, Math.min(to - half, middle));
  return [centre - half, centre + half];
}

function overlap(a: Box, b: Box): boolean {
  return a.left < b.right && a.right > b.left && a.top < b.bottom && a.bottom > b.top;
}

const CHECK_MS = 200;

/**
 * Report the free rectangle and the height of `view` repeatedly, once they are stable: a rectangle in
 * the middle of a resize would move the camera. Returns a function that ends it.
 *
 * Elements with `data-covers` cover the view, and so do the parts of the deck that lie on it. Notices
 * are ignored, because they would move the camera and lie above the robot.
 */
export function watchFreeRectangle(view: Element, report: Report): () => void {
  let before = "";
  let free: Box | null = null;
  const timer = setInterval(() => {
    const picture = view.getBoundingClientRect();
    if (picture.width === 0 || picture.height === 0) return;
    const nodes = document.querySelectorAll(".view [data-covers], .deck > *");
    const shown = [...nodes].filter((node) => getComputedStyle(node).visibility !== "hidden");
    const covers = shown.map((node) => node.getBoundingClientRect());
    const now = JSON.stringify([picture, covers]);
    if (now === before) report((free ??= freeRectangle(picture, covers)), picture.height);
    else [before, free] = [now, null];
  }, CHECK_MS);
  return () => clearInterval(timer);
}
