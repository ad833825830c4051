import assert from "node:assert/strict";
import { test } from "node:test";

import { connect, pass } from "./browser.js";

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
