// The part of the picture that nothing covers. The dashboard frames the robot in it.

/** Edges in pixels, to the right and down. */
export interface Box {
  left: number;
  top: number;
  right: number;
  bottom: number;
}

const LEAST_SHARE = 0.4; // With less room, as under a large map, the robot stays in the middle.
const ROBOT_ASPECT = 1.6; // A robot on its floor is about so much wider in the picture than high.

/**
 * Return the free rectangle of a picture in which a robot appears largest, in fractions.
 *
 * Each edge of it is one of the picture or of what covers it. Without room, it is the whole picture.
 */
export function freeRectangle(picture: Box, covers: readonly Box[]): Box {
  const inside = covers
    .map((box) => clipped(box, picture))
    .filter(({ left, top, right, bottom }) => right > left && bottom > top);
  const edges = (low: keyof Box, high: keyof Box) => [
    [picture[low], ...inside.map((box) => box[high])],
    [picture[high], ...inside.map((box) => box[low])],
  ];
  const [lefts = [], rights = []] = edges("left", "right");
  const [tops = [], bottoms = []] = edges("top", "bottom");
  let best = picture;
  const room = (width: number, height: number) => Math.min(width / ROBOT_ASPECT, height);
  const least = LEAST_SHARE * room(picture.right - picture.left, picture.bottom - picture.top);
  let most: [number, number] = [least, 0];
  for (const left of lefts)
    for (const right of rights.filter((edge) => edge > left))
      for (const top of tops)
        for (const bottom of bottoms.filter((edge) => edge > top)) {
          const box = { left, top, right, bottom };
          const [width, height] = [right - left, bottom - top];
          const rank: [number, number] = [room(width, height), width * height];
          const isBetter = rank[0] > most[0] || (rank[0] === most[0] && rank[1] > most[1]);
          if (isBetter && !inside.some((cover) => overlap(cover, box))) [best, most] = [box, rank];
        }
  return fractions(best, picture);
}

function clipped(box: Box, { left, top, right, bottom }: Box): Box {
  return {
    left: Math.max(left, box.left),
    top: Math.max(top, box.top),
    right: Math.min(right, box.right),
    bottom: Math.min(bottom, box.bottom),
  };
}

function overlap(a: Box, b: Box): boolean {
  return a.left < b.right && a.right > b.left && a.top < b.bottom && a.bottom > b.top;
}

function fractions(box: Box, picture: Box): Box {
  const [width, height] = [picture.right - picture.left, picture.bottom - picture.top];
  const round = (share: number) => Math.round(1000 * share) / 1000;
  return {
    left: round((box.left - picture.left) / width),
    top: round((box.top - picture.top) / height),
    right: round((box.right - picture.left) / width),
    bottom: round((box.bottom - picture.top) / height),
  };
}

const CHECK_MS = 200;

/**
 * Report the free rectangle of `view` again and again, while it does not change: a rectangle on the
 * way of a resize would move the camera. Returns a function that ends it.
 *
 * Elements with `data-covers` cover the view, and so do the parts of the deck that lie on it. Notices
 * do not count: they would move the camera, and lie above the middle half, where the robot is.
 */
export function watchFreeRectangle(view: HTMLElement, report: (free: Box) => void): () => void {
  let before = "";
  const check = () => {
    const picture = view.getBoundingClientRect();
    if (picture.width === 0 || picture.height === 0) return;
    const covers = document.querySelectorAll(".view [data-covers], .deck > *");
    const boxes = [...covers].map((node) => node.getBoundingClientRect());
    const free = freeRectangle(picture, boxes);
    const now = JSON.stringify(free);
    if (now === before) report(free);
    before = now;
  };
  const timer = setInterval(check, CHECK_MS);
  return () => clearInterval(timer);
}
