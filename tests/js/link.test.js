import assert from "node:assert/strict";
import { test } from "node:test";

import { connect, pass } from "./browser.js";

const { Recorder } = await import("../../src/tsd_twin/dashboard/static/plots.js");

test("a listener hears messages of its types until its signal aborts", () => {
  const { link, state, say } = connect();
  const heard = [];
  const controller = new AbortController();
  link.on(["state", "reply"], ({ t }) => heard.push(t), controller.signal);
  state();
  say({ t: "reply", to: "arm", ok: true, reason: "" });
  assert.deepEqual(heard, ["state", "reply"]);
  controller.abort();
  state();
  assert.equal(heard.length, 2);
});

test("a listener that another one adds hears from the next message on, one that is ended nothing", () => {
  const { link, state } = connect();
  const heard = [];
  const controller = new AbortController();
  link.on("state", () => {
    if (heard.push("first") > 1) return;
    controller.abort();
    link.on("state", () => heard.push("added"));
  });
  link.on("state", () => heard.push("ended"), controller.signal);
  state();
  assert.deepEqual(heard, ["first"]);
  state();
  assert.deepEqual(heard, ["first", "first", "added"]);
});

test("another name of the operator goes out with a new connection, and the same one with none", () => {
  const { link, socket, newestSocket } = connect();
  assert.equal(socket.address.searchParams.get("name"), null);
  link.rename("");
  pass(1000);
  assert.equal(newestSocket(), socket);
  link.rename("anna");
  assert.equal(link.connected, false);
  assert.equal(socket.readyState, 3);
  pass(1000);
  assert.equal(newestSocket().address.searchParams.get("name"), "anna");
});

const ROBOT = { t: "robot", id: "tsd", panel: "wheels", twist_axes: [], modules: [] };
const STATUS = { consistency: { residual_mps: 0 } };

function recorded(say, state, robot, rpm) {
  say({ ...ROBOT, ...robot });
  const wheels = rpm.map((each) => ({ rpm: each, set_rpm: 0 }));
  state(STATUS, { twist: null, commanded: null, modules: [], wheels });
}

test("plots of a robot go on when its description changes, and begin anew with another robot", () => {
  const { link, say, state } = connect();
  const recorder = new Recorder(link);
  recorded(say, state, { wheels: ["wheel1"] }, [10]);
  recorded(say, state, { wheels: ["wheel1", "wheel2"] }, [11, 21]);
  assert.equal(recorder.count, 2);
  assert.equal(recorder.newest("wheel1"), 11);
  assert.equal(recorder.newest("wheel2"), 21);
  recorded(say, state, { id: "other", wheels: ["wheel2"] }, [30]);
  assert.equal(recorder.count, 1);
  assert.ok(Number.isNaN(recorder.newest("wheel1")));
});
