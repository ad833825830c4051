import assert from "node:assert/strict";
import { test } from "node:test";

import { connect, openPage, pass, stall } from "./browser.js";

const STATIC = "../../src/tsd_twin/dashboard/static";
const { Link } = await import(`${STATIC}/link.js`);
const { notConnected, acquireBlockedReason } = await import(`${STATIC}/blocked_reasons.js`);

test("a listener hears messages of its types until its signal aborts", () => {
  const { link, state, say } = connect();
  const heard = [];
  const controller = new AbortController();
  link.on(["state", "reply"], ({ t }) => heard.push(t), controller.signal);
  state();
  say({ t: "reply", to: "arm", ok: true, why: null });
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

test("a page that loads is connecting, and without a connection for five seconds it says so", () => {
  const { newestSocket } = connect();
  openPage();
  const link = new Link("page");
  link.open();
  pass(4900);
  assert.equal(notConnected(link), "Connecting to the dashboard");
  assert.equal(acquireBlockedReason(link), "Connecting to the dashboard.");
  pass(200);
  assert.equal(acquireBlockedReason(link), "No connection to the dashboard.");
  newestSocket().onopen();
  assert.equal(acquireBlockedReason(link), "No robot is on the bus.");
});

test("a connection that is lost is said at once", () => {
  const { newestSocket } = connect();
  openPage();
  const link = new Link("page");
  link.open();
  pass(300);
  newestSocket().onopen();
  assert.ok(link.isLoading()); // No state has come.
  newestSocket().onclose();
  assert.ok(!link.isLoading());
  assert.equal(acquireBlockedReason(link), "No connection to the dashboard.");
});

test("a page that stalls reads what came meanwhile before it takes the connection for lost", () => {
  const { link, socket, say } = connect();
  pass(1000);
  stall(30000);
  pass(300);
  assert.ok(link.connected);
  say({ t: "heartbeat", sent_ms: performance.now() - 30000 });
  pass(1800);
  assert.ok(link.connected);
  pass(400);
  assert.ok(!link.connected, "no echo for two seconds in which the page ran");
  assert.equal(socket.readyState, 3);
});
