// Map drawing. The colours match the scene and are listed in the key sheet.

import { labelPlaces, lengthText } from "./map_view.js";

const [ESTIMATE, ROUTE, ENVELOPE, STALE] = ["#2484e3", "#966eff", "#e85a3c", "#80848a"];
const FONT = "600 12px system-ui, sans-serif";
const LEAST_RADIUS_PX = 6;
const MARGIN_PX = 12;

/** @param {CanvasRenderingContext2D} pen @param {MapView} view @param {MapContent} content */
export function drawMap(pen, view, content) {
  const { size, envelope, shown, routes, robots, trailOf, stroke } = content;
  pen.clearRect(0, 0, size.width, size.height);
  pen.lineJoin = pen.lineCap = "round";
  pen.font = FONT;
  drawGrid(pen, view, content);
  if (envelope !== null && shown !== undefined) {
    const [x, y, heading] = shown.pose;
    const [c, s] = [Math.cos(heading), Math.sin(heading)];
    path(
      pen,
      view,
      envelope.map(([a, b]) => [x + c * a - s * b, y + s * a + c * b]),
    );
    pen.closePath();
    stroked(pen, ENVELOPE, 2);
    pen.globalAlpha = 0.2;
    pen.fillStyle = ENVELOPE;
    pen.fill();
    pen.globalAlpha = 1;
  }
  for (const { id } of robots) {
    path(pen, view, trailOf(id));
    stroked(pen, ESTIMATE, 2);
  }
  for (const points of Object.values(routes)) {
    path(pen, view, points);
    stroked(pen, ROUTE, 4);
    const end = points.at(-1);
    if (end) dot(pen, view.toPicture(end), 6, ROUTE);
  }
  for (const robot of robots) if (robot !== shown) drawRobot(pen, view, content, robot);
  if (shown) drawRobot(pen, view, content, shown); // On top of the others.
  if (content.names.length > 1) drawNames(pen, view, content);
  if (stroke.length > 0) {
    pen.beginPath();
    for (const pixels of stroke) pen.lineTo(...pixels);
    stroked(pen, ROUTE, 4);
    dot(pen, stroke[0], 7, ROUTE);
  }
  drawScale(pen, view, content);
}

/** @param {CanvasRenderingContext2D} pen @param {MapView} view @param {MapContent} content */
function drawGrid(pen, view, { size: { width, height }, line }) {
  const step = view.gridM();
  const [topX, topY] = view.toFloor([0, 0]);
  const [lowX, lowY] = view.toFloor([width, height]);
  for (let x = Math.ceil(lowX / step) * step; x <= topX; x += step) {
    const [, down] = view.toPicture([x, 0]);
    straight(pen, [0, down], [width, down]);
    stroked(pen, line, x === 0 ? 2 : 1);
  }
  for (let y = Math.ceil(lowY / step) * step; y <= topY; y += step) {
    const [right] = view.toPicture([0, y]);
    straight(pen, [right, 0], [right, height]);
    stroked(pen, line, y === 0 ? 2 : 1);
  }
}

/**
 * @param {CanvasRenderingContext2D} pen @param {MapView} view @param {MapContent} content
 * @param {MapRobot} robot
 */
function drawRobot(pen, view, { names, isStale }, robot) {
  const heading = robot.pose[2];
  const { at, radius } = circleOf(view, robot);
  const name = names.find(({ id }) => id === robot.id);
  const colour = robot.stale || isStale ? STALE : (name?.colour ?? ESTIMATE);
  // The tip points forward: x of the world is up, y is left.
  const [ahead, aside] = [
    [-Math.sin(heading), -Math.cos(heading)],
    [-Math.cos(heading), Math.sin(heading)],
  ];
  const corner = (/** @type {number} */ forward, /** @type {number} */ left) =>
    /** @type {[number, number]} */ (
      [0, 1].map((i) => at[i] + forward * ahead[i] + left * aside[i])
    );
  pen.beginPath();
  pen.arc(...at, radius, 0, 2 * Math.PI);
  pen.fillStyle = colour;
  pen.globalAlpha = 0.35;
  pen.fill();
  pen.globalAlpha = 1;
  stroked(pen, colour, 2);
  pen.beginPath();
  for (const point of [corner(radius + 9, 0), corner(radius + 1, 6), corner(radius + 1, -6)])
    pen.lineTo(...point);
  pen.closePath();
  pen.fillStyle = colour;
  pen.fill();
}

/** @param {MapView} view @param {MapRobot} robot */
function circleOf(view, { pose: [x, y], reach_m: reach }) {
  return { at: view.toPicture([x, y]), radius: Math.max(LEAST_RADIUS_PX, reach * view.scale) };
}

/** Names next to the robots; the displayed robot has priority. @type {typeof drawGrid} */
function drawNames(pen, view, { names, ink, robots, shown }) {
  const ordered = [...robots].sort((a, b) => Number(b === shown) - Number(a === shown));
  const texts = ordered.map(({ id, stale }) => (stale ? `${id} (silent)` : id));
  const places = labelPlaces(
    ordered.map((robot, i) => ({
      ...circleOf(view, robot),
      width: pen.measureText(texts[i]).width,
    })),
    [view.box.left, view.box.left + view.box.width],
  );
  pen.textAlign = "center";
  for (const [i, [x, y]] of places.entries()) {
    pen.fillStyle = ink;
    pen.fillText(texts[i], x, y);
    pen.fillStyle = names.find(({ id }) => id === ordered[i].id)?.colour ?? ESTIMATE;
    const { width } = pen.measureText(texts[i]);
    pen.fillRect(x - width / 2, y + 3, width, 2); // In the robot's colour, for identification.
  }
}

/** Scale bar and x arrow, in the lower left corner. @type {typeof drawGrid} */
function drawScale(pen, view, { ink }) {
  const { left, top, height } = view.box;
  const low = top + height - MARGIN_PX;
  const [from, to] = [left + MARGIN_PX, left + MARGIN_PX + view.barM() * view.scale];
  pen.beginPath();
  for (const [x, y] of [
    [from, low - 5],
    [from, low],
    [to, low],
    [to, low - 5],
  ])
    pen.lineTo(x, y);
  stroked(pen, ink, 2);
  pen.fillStyle = ink;
  pen.textAlign = "left";
  pen.fillText(lengthText(view.barM()), from + 5, low - 5);
  const [foot, tip] = [low - 24, low - 52];
  straight(pen, [from + 6, foot], [from + 6, tip]);
  pen.moveTo(from + 1, tip + 7);
  pen.lineTo(from + 6, tip);
  pen.lineTo(from + 11, tip + 7);
  stroked(pen, ink, 2);
  pen.fillText("x", from + 15, tip + 10);
}

/** @param {CanvasRenderingContext2D} pen @param {MapView} view @param {(FloorPoint | null)[]} points */
function path(pen, view, points) {
  pen.beginPath();
  let isNew = true;
  for (const point of points) {
    if (point !== null && isNew) pen.moveTo(...view.toPicture(point));
    else if (point !== null) pen.lineTo(...view.toPicture(point));
    isNew = point === null;
  }
}

/**
 * @param {CanvasRenderingContext2D} pen @param {[number, number]} from @param {[number, number]} to
 */
function straight(pen, from, to) {
  pen.beginPath();
  pen.moveTo(...from);
  pen.lineTo(...to);
}

/** @param {CanvasRenderingContext2D} pen @param {string} colour @param {number} width */
function stroked(pen, colour, width) {
  pen.strokeStyle = colour;
  pen.lineWidth = width;
  pen.stroke();
}

/**
 * @param {CanvasRenderingContext2D} pen @param {[number, number]} at @param {number} radius
 * @param {string} colour
 */
function dot(pen, at, radius, colour) {
  pen.beginPath();
  pen.arc(...at, radius, 0, 2 * Math.PI);
  pen.fillStyle = colour;
  pen.fill();
  stroked(pen, "#fff", 2);
}
