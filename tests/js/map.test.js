import assert from "node:assert/strict";
import { test } from "node:test";

import { connect } from "./browser.js";

const STATIC = "../../src/tsd_twin/dashboard/static";
const { labelPlaces, lengthText, MapTrails, MapView } = await import(`${STATIC}/map_view.js`);

const BOX = { left: 10, top: 60, width: 300, height: 200 };

function view(spanM) {
  const made = new MapView();
  made.setSpan(spanM);
  made.fit(BOX);
  return made;
}

test("a click is taken for the place that is drawn there, at every scale and place", () => {
  for (const spanM of [1, 4, 64]) {
    const map = view(spanM);
    map.follow([12.3, -4.5]);
    for (const place of [
      [12.3, -4.5],
      [12.3 + 0.3 * spanM, -4.5 - 0.4 * spanM],
    ]) {
      const again = map.toFloor(map.toPicture(place));
      assert.ok(Math.hypot(again[0] - place[0], again[1] - place[1]) < 0.001);
    }
  }
});

test("x of the world is up and y is left, and a metre is as long both ways", () => {
  const map = view(4);
  const [right, down] = map.toPicture([0, 0]);
  assert.deepEqual([right, down], [10 + 150, 60 + 100]);
  const [upRight, upDown] = map.toPicture([1, 0]);
  const [leftRight, leftDown] = map.toPicture([0, 1]);
  assert.deepEqual([upRight, upDown], [right, down - map.scale]);
  assert.deepEqual([leftRight, leftDown], [right - map.scale, down]);
});

test("the map stands while the robot is near its middle, and never loses it", () => {
  const map = view(4);
  const before = map.toPicture([0, 0]);
  map.follow([0.9, -0.9]);
  assert.deepEqual(map.toPicture([0, 0]), before);
  for (let x = 0; x < 20; x += 0.37) {
    map.follow([x, -x]);
    const [right, down] = map.toPicture([x, -x]);
    assert.ok(right > 60 && right < 260 && down > 105 && down < 215, `${right} ${down}`);
  }
});

test("the scale bar has a round length and fits into the picture", () => {
  for (const spanM of [1, 2, 4, 8, 16, 32, 64]) {
    const map = view(spanM);
    const barM = map.barM();
    assert.match(barM.toPrecision(1), /^0?[.0]*[125]0*(e\+1)?$/);
    const pixels = barM * map.scale;
    assert.ok(pixels <= 0.4 * BOX.width + 1e-9 && pixels > 0.1 * BOX.width);
  }
  assert.equal(lengthText(0.5), "50 cm");
  assert.equal(lengthText(2), "2 m");
});

test("a trail goes on from what the server has, and breaks where the pose was set", () => {
  const trails = new MapTrails();
  const at = (x, y) => trails.extend([{ id: "tsd", pose: [x, y, 0], reach_m: 0.2, stale: false }]);
  trails.replace({ tsd: [[0, 0]] });
  at(0.04, 0);
  assert.equal(trails.of("tsd").length, 1);
  at(0.06, 0);
  at(3, 0);
  assert.deepEqual(trails.of("tsd"), [[0, 0], [0.06, 0], null, [3, 0]]);
  for (let i = 0; i < 3000; i += 1) at(3 + i / 10, 0);
  assert.ok(trails.of("tsd").length <= 800);
  assert.deepEqual(trails.of("other"), []);
});

const { ViewKeeper } = await import(`${STATIC}/view_settings.js`);
const { PRESETS } = await import(`${STATIC}/presets.js`);

function remember(entries = {}) {
  const kept = new Map(Object.entries(entries));
  globalThis.localStorage = {
    getItem: (key) => kept.get(key) ?? null,
    setItem: (key, value) => kept.set(key, value),
  };
  return kept;
}

test("keys 1 to 3 turn the camera, once, and the browser keeps it", () => {
  const kept = remember();
  const { link, take } = connect();
  const keeper = new ViewKeeper(link);
  const press = (code, fields = {}) =>
    keeper.key({ code, type: "keydown", repeat: false, ...fields });
  for (const [code, camera] of [
    ["Digit2", "top"],
    ["Numpad3", "chase"],
    ["Digit1", "3-D"],
  ]) {
    assert.ok(press(code));
    assert.ok(press(code, { repeat: true }));
    assert.ok(press(code, { type: "keyup" }));
    const [{ settings, look }, ...more] = take("view");
    assert.deepEqual([settings.camera, look, more], [camera, true, []]);
    assert.equal(JSON.parse(kept.get("tsd.view")).camera, camera);
  }
  assert.ok(!press("Digit4") && !press("KeyW"));
});

test("what was kept is sent with each connection, and nothing without it", () => {
  remember();
  const fresh = connect();
  new ViewKeeper(fresh.link);
  fresh.socket.onopen();
  assert.deepEqual(fresh.take("view"), []);
  remember({ "tsd.view": '{"camera":"chase","hidden":["trail","of an older version"],"tilt":7}' });
  const { link, socket, say, take } = connect();
  new ViewKeeper(link);
  socket.onopen();
  const [{ settings, look }] = take("view");
  assert.deepEqual([settings.camera, settings.hidden, settings.tilt], ["chase", ["trail"], "x1"]);
  assert.equal(look, false);
  // The panel has changed something: the next connection has it.
  say({ t: "view", settings: { ...settings, follow: false } });
  socket.onopen();
  assert.equal(take("view")[0].settings.follow, false);
});

test("presets never put the controls or the view away", () => {
  for (const { away } of Object.values(PRESETS))
    assert.ok(!away.includes("Drive") && !away.includes("View"));
});

test("names of robots do not overlap, however near to one another the robots are", () => {
  const width = 48;
  for (const apartPx of [0, 3, 10, 25, 60, 200]) {
    for (const [stepX, stepY] of [
      [1, 0],
      [0, 1],
      [0.7, -0.7],
    ]) {
      const robots = [0, 1, 2, 3, 4].map((i) => ({
        at: [100 + i * apartPx * stepX, 80 + i * apartPx * stepY],
        radius: 9,
        width,
      }));
      const places = labelPlaces(robots);
      for (const [i, a] of places.entries())
        for (const b of places.slice(i + 1))
          assert.ok(Math.abs(a[0] - b[0]) >= width || Math.abs(a[1] - b[1]) >= 12, `${a} ${b}`);
    }
  }
});

test("a name stands on no robot where there is room beside it", () => {
  const robots = [
    { at: [100, 80], radius: 9, width: 30 },
    { at: [100, 110], radius: 9, width: 30 },
  ];
  const [first, second] = labelPlaces(robots);
  assert.deepEqual(first, [100, 80 - 9 - 14]); // Below it is the other one.
  assert.deepEqual(second, [100, 110 + 9 + 24]);
});

test("a name is not cut at the edge of the picture", () => {
  const robots = [
    { at: [290, 80], radius: 9, width: 60 },
    { at: [5, 80], radius: 9, width: 60 },
    { at: [400, 80], radius: 9, width: 60 }, // Its robot is not in the picture.
  ];
  const [right, left, beyond] = labelPlaces(robots, [0, 300]);
  assert.ok(right[0] + 30 <= 300);
  assert.ok(left[0] - 30 >= 0);
  assert.equal(beyond[0], 400);
});
