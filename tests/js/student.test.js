import assert from "node:assert/strict";
import { test } from "node:test";

import { connect, pass } from "./browser.js";

const { linkTo, settingOf, StudentModel } =
  await import("../../src/tsd_twin/dashboard/static/student_model.js");

const SETTING = {
  base: "tsd",
  knobs: {
    "drive.pivot_radius_m": 0.2,
    "drive.azimuths_deg.1": -150.5,
    "drive.max_tilt_deg": 1e-7,
  },
  twist: [0.1, -2, 1e-9],
};
const KNOB = { key: "drive.max_tilt_deg", usual: 30, value: 30 };

/** Return the reply of the server to a request. */
function replyTo({ number, base }, fields = {}) {
  return {
    t: "student",
    number,
    base,
    bases: [],
    knobs: [KNOB],
    figures: null,
    problem: "",
    toml: null,
    ...fields,
  };
}

test("a link carries the setting", () => {
  const link = linkTo(
    SETTING,
    "https://host/robots/?websocket=wss%3A%2F%2Felsewhere&drive.x=9#there",
  );
  assert.deepEqual(settingOf(new URL(link).search), SETTING);
  assert.ok(link.startsWith("https://host/robots/?student=tsd&drive.pivot_radius_m=0.2"));
  assert.ok(!link.includes("elsewhere"));
});

test("an address without a setting has none, and what is no number is left out", () => {
  assert.equal(settingOf("?fixedDpr=0.5"), null);
  const { knobs, twist } = settingOf("?student=kiwi&drive.a=x&drive.b=&drive.c=1e999&twist=1_2");
  assert.deepEqual(knobs, {});
  assert.equal(twist.length, 3);
});

test("one request is under way at a time, and the newest setting follows", () => {
  const { link, say, take } = connect();
  const model = new StudentModel(link, "");
  model.refresh();
  const [first] = take("student");
  for (const tilt of [10, 11, 12]) model.turn("drive.max_tilt_deg", tilt);
  pass(1000);
  assert.deepEqual(take("student"), []);
  say(replyTo(first));
  const [second] = take("student");
  assert.deepEqual(second.knobs, { "drive.max_tilt_deg": 12 });
  say(replyTo(second));
  pass(1000);
  model.refresh();
  assert.deepEqual(take("student"), []);
});

test("requests of a hand that keeps turning stay below the limit of the server", () => {
  const { link, say, take } = connect();
  const model = new StudentModel(link, "");
  let count = 0;
  for (let ms = 0; ms < 2000; ms += 1) {
    model.turn("drive.max_tilt_deg", ms);
    pass(1);
    for (const request of take("student")) {
      count += 1;
      say(replyTo(request));
    }
  }
  assert.ok(count > 10 && count <= 40, `${count} in two seconds`);
});

test("a request that is lost is sent again, also after a new connection", () => {
  const { link, say, take } = connect();
  const model = new StudentModel(link, "");
  model.refresh();
  assert.equal(take("student").length, 1);
  pass(1000);
  model.refresh();
  assert.equal(take("student").length, 0);
  pass(1000);
  model.refresh();
  assert.equal(take("student").length, 1);
  say({ t: "welcome", operator: "ann", role: "operator", may_stop: true, robots: [], robot: null });
  model.refresh();
  pass(100);
  assert.equal(take("student").length, 1);
});

test("a knob back at its usual value is no change", () => {
  const { link, say, take } = connect();
  const model = new StudentModel(link, "?student=tsd&drive.max_tilt_deg=20");
  model.refresh();
  say(replyTo(take("student")[0]));
  model.turn("drive.max_tilt_deg", 30);
  assert.deepEqual(model.setting.knobs, {});
  model.turn("drive.max_tilt_deg", 20);
  model.choose("kiwi");
  assert.deepEqual(model.setting.knobs, {});
});

test("the file is asked for until it comes, or there is none", () => {
  for (const fields of [{ toml: "name" }, { problem: "impossible" }]) {
    const { link, say, take } = connect();
    const model = new StudentModel(link, "");
    model.refresh();
    const [plain] = take("student");
    model.requestToml();
    say(replyTo(plain));
    pass(200);
    const [asked] = take("student");
    assert.equal(asked.toml, true);
    say(replyTo(asked, fields));
    model.turn("drive.max_tilt_deg", 7);
    pass(200);
    assert.equal(take("student")[0].toml, false);
  }
});
