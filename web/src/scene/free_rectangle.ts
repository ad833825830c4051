// The part of the picture that nothing covers. The dashboard frames the robot in it.

/** Edges in pixels or fractions, to the right and down. */
export type Box = Pick<DOMRect, "left" | "top" | "right" | "bottom">;

/** Takes fractions of the picture, and its height in pixels. */
export type Report = (free: Box, height: number) => void;

const LEAST_SHARE = 0.4; // With less room, as under a large map, the robot stays in the middle.
const ROBOT_ASPECT = 1.6; // Typical ratio of width and height of a robot in the picture.
const ROOM = 1.25; // Least length of the longer side, relative to what the robot needs.

/**
 * Return the rectangle, in fractions of a picture, that no cover touches and in which a robot is
 * largest, cut so that it is near the middle. Without room, it is the whole picture.
 */
export function freeRectangle({ left, top, right, bottom }: Box, covers: readonly Box[]): Box {
  const picture = { left, top, right, bottom };
  const size = (box: Box) => Math.min((box.right - box.left) / ROBOT_ASPECT, box.bottom - box.top);
  const over = covers.filter((cover) => overlap(cover, picture));
  const beside = over.map((c) => ({ left: c.right, top: c.bottom, right: c.left, bottom: c.top }));
  const intervals = (low: "left" | "top", high: "right" | "bottom", all = [picture, ...beside]) =>
    all.flatMap((one) => all.map((other) => [one[low], other[high]] as const));
  let free = { ...picture, right: left };
  for (const [left, right] of intervals("left", "right"))
    for (const [top, bottom] of intervals("top", "bottom")) {
      const box = { left, top, right, bottom };
      if (size(box) > size(free) && !over.some((cover) => overlap(cover, box))) free = box;
    }
  if (size(free) < LEAST_SHARE * size(picture)) free = picture;
  const [from, to] = cut([left, right], [free.left, free.right], ROOM * ROBOT_ASPECT * size(free));
  const [above, below] = cut([top, bottom], [free.top, free.bottom], ROOM * size(free));
  return { left: from, top: above, right: to, bottom: below };
}

/** Cut a part of a whole so that it is near its middle; `least` remains. In fractions. */
function cut([low, high]: [number, number], [from, to]: [number, number], least: number) {
  const middle = (low + high) / 2;
  const half = Math.min((to - from) / 2, Math.max(least / 2, Math.min(middle - from, to - middle)));
  const centre = Math.max(from + half, Math.min(to - half, middle));
  const share = (at: number) => Math.round((1000 * (at - low)) / (high - low)) / 1000;
  return [share(centre - half), share(centre + half)] as const;
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
  const timer = setInterval(() => {
    const picture = view.getBoundingClientRect();
    if (picture.width === 0 || picture.height === 0) return;
    const nodes = [...document.querySelectorAll(".view [data-covers], .deck > *")];
    const shown = nodes.filter((node) => getComputedStyle(node).visibility !== "hidden");
    const covers = shown.map((node) => node.getBoundingClientRect());
    const free = freeRectangle(picture, covers);
    const now = JSON.stringify([free, picture.height]);
    if (now === before) report(free, picture.height);
    before = now;
  }, CHECK_MS);
  return () => clearInterval(timer);
}
