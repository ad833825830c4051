// The part of the picture that nothing covers. The dashboard frames the robot in it.

/** Edges in pixels or fractions, to the right and down. */
export type Box = Pick<DOMRect, "left" | "top" | "right" | "bottom">;

/** Takes fractions of the picture, and its height in pixels. */
export type Report = (free: Box, height: number) => void;

const LEAST_SHARE = 0.4; // With less room, as under a large map, the robot stays in the middle.
const ROBOT_ASPECT = 1.6; // Typical ratio of width and height of a robot in the picture.

/**
 * Return the part of a picture that is left after each cover has cut off the side that costs a robot
 * the least of its size, in fractions. Without room, it is the whole picture.
 */
export function freeRectangle({ left, top, right, bottom }: Box, covers: readonly Box[]): Box {
  const picture = { left, top, right, bottom };
  const size = (box: Box) => Math.min((box.right - box.left) / ROBOT_ASPECT, box.bottom - box.top);
  const area = (box: Box) => (box.right - box.left) * (box.bottom - box.top);
  let free = picture;
  for (const cover of covers) {
    if (!overlap(cover, free)) continue;
    const cuts: Box[] = [
      { ...free, left: cover.right },
      { ...free, right: cover.left },
      { ...free, top: cover.bottom },
      { ...free, bottom: cover.top },
    ];
    free = cuts.sort((a, b) => size(b) - size(a) || area(b) - area(a))[0]!;
  }
  if (size(free) < LEAST_SHARE * size(picture)) free = picture;
  const share = (part: number, whole: number) => Math.round((1000 * part) / whole) / 1000;
  return {
    left: share(free.left - left, right - left),
    top: share(free.top - top, bottom - top),
    right: share(free.right - left, right - left),
    bottom: share(free.bottom - top, bottom - top),
  };
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
