import axe from "axe-core";
import { beforeEach, describe, expect, test, vi } from "vitest";
import type { RouteState } from "../../src/generated/wire";
import { openDeck } from "../support/deck";
import { fakeBrowser, fire, LEASE, lift, place, press, ROBOT } from "../support/page";

beforeEach(fakeBrowser);

const FINGER = { pointerId: 7, button: 0, clientX: 66, clientY: 0 };
const STOPPED = { mode: "stopped", stop: { code: "stop_requested", params: { by: "ann" } } };

describe("STOP", () => {
  test("acts when it is touched, and once", () => {
    const { find, does, take } = openDeck();
    const stop = find(".stop")!;
    does(() => fire(stop, "pointerdown", { pointerId: 1, button: 0 }));
    expect(take("stop")).toHaveLength(1);
    does(() => fire(stop, "click", { detail: 1 }));
    expect(take("stop")).toEqual([]);
  });

  test("acts on the click of a key or of assistive technology, once, also after a touch", () => {
    const { find, does, take } = openDeck();
    const stop = find(".stop")!;
    for (const detail of [0, 1]) {
      does(() => fire(stop, "click", { detail }));
      expect(take("stop")).toHaveLength(1);
    }
    does(() => fire(stop, "pointerdown", { pointerId: 1, button: 0 }));
    does(() => fire(stop, "pointerleave"));
    take();
    does(() => fire(stop, "click", { detail: 0 }));
    expect(take("stop")).toHaveLength(1);
  });

  test("is the same button in all states, the first of the deck, and hollow while latched", () => {
    const { find, state, pass } = openDeck();
    const stop = find(".stop")!;
    for (const status of [{}, { mode: "driving" }, STOPPED, { mode: "disarmed" }]) {
      state(status);
      expect(find("button")).toBe(stop);
      expect(stop.classList.contains("latched")).toBe(status === STOPPED);
      expect(stop.getAttribute("aria-disabled")).toBeNull();
    }
    pass(3000);
    expect(find("button")).toBe(stop);
  });

  test.each<[string, object, object, string]>([
    ["of a robot that is stopped", STOPPED, {}, "active until the reset"],
    ["of a replay", {}, { source: "recording" }, "stops all live robots now"],
    ["of a robot that drives", { mode: "driving" }, {}, "Space or gamepad B"],
  ])("%s says what comes of it", (_, status, fields, said) => {
    const { state, text } = openDeck();
    state(status, fields);
    expect(text(".hint")).toBe(said);
  });

  test("says when the robot cannot hear it, and acts all the same", () => {
    const { socket, does, pass, text, find, session } = openDeck();
    pass(1000);
    expect(text(".hint")).toBe("no signal: the robot may not hear it");
    socket.readyState = 3;
    does(() => socket.onclose());
    expect(text(".hint")).toBe("no link: the robot cannot hear it");
    does(() => fire(find(".stop"), "pointerdown", { pointerId: 1, button: 0 }));
    pass(700);
    expect(session.stop.unconfirmed.value).toBe(true);
  });

  test("is disabled with the reason for a viewer who may not stop", () => {
    const { say, welcome, find, text, does, take } = openDeck();
    say({ ...welcome, role: "viewer", may_stop: false });
    expect(find(".stop")?.getAttribute("aria-disabled")).toBe("true");
    expect(text(".hint")).toBe("You may look, not stop.");
    does(() => fire(find(".stop"), "pointerdown", { pointerId: 1, button: 0 }));
    expect(take("stop")).toEqual([]);
  });

  test("that is not confirmed is an alert, until it is acknowledged or confirmed", () => {
    const { find, text, does, pass, state } = openDeck();
    const stopIt = () => {
      does(() => fire(find(".stop"), "pointerdown", { pointerId: 1, button: 0 }));
      pass(700, {});
    };
    stopIt();
    expect(text("[role=alert]")).toContain("STOP is not confirmed.");
    expect(text(".hint")).toBe("not confirmed");
    does(() => find(".do button")!.click());
    expect(find("[role=alert]")).toBeNull();
    stopIt();
    state(STOPPED);
    expect(find("[role=alert]")).toBeNull();
  });
});

describe("stick", () => {
  test.each([
    ["ahead", { clientX: 66, clientY: 0 }, { vx: 2, vy: 0 }],
    ["back", { clientX: 66, clientY: 132 }, { vx: -2, vy: 0 }],
    ["to the left", { clientX: 0, clientY: 66 }, { vx: 0, vy: 2 }],
    ["to the right", { clientX: 132, clientY: 66 }, { vx: 0, vy: -2 }],
  ])("pushed %s drives there, and the knob is there", (_, at, twist) => {
    const { find, does, take } = openDeck();
    const stick = find(".stick")!;
    place(stick, 132, 132);
    does(() => fire(stick, "pointerdown", { ...FINGER, ...at }));
    const [command] = take("drive");
    expect(command!["vx"]).toBeCloseTo(twist.vx);
    expect(command!["vy"]).toBeCloseTo(twist.vy);
    const knob = find(".st-knob")!;
    const shown = [knob.getAttribute("cx"), knob.getAttribute("cy")].map(Number);
    const towards = [at.clientX - 66, at.clientY - 66].map(Math.sign);
    expect(shown.map((part) => Math.sign(Math.round(part)))).toEqual(towards);
    does(() => fire(stick, "pointerup", FINGER));
    expect(Number(find(".st-knob")!.getAttribute("cy"))).toBeCloseTo(0);
  });

  test("shows what the limits let through: a dot, a line to it, and a ring", () => {
    const { find, does, state } = openDeck();
    const stick = find(".stick")!;
    place(stick, 132, 132);
    does(() => fire(stick, "pointerdown", FINGER));
    state({ mode: "driving" }, { commanded: [2, 0, 0] });
    expect(find(".st-cap")).toBeNull();
    const limits = { speed_mps: 2, turn_rate_rad_per_s: 4, max_command_age_s: 0.25, why: [] };
    state({ mode: "driving", limits: { ...limits, applied: 0.5 } }, { commanded: [1, 0, 0] });
    const [knob, dot] = [".st-knob", ".st-dot"].map((each) =>
      Number(find(each)!.getAttribute("cy")),
    );
    expect(dot).toBeCloseTo(knob! / 2);
    expect(Number(find(".st-cap")!.getAttribute("r"))).toBeCloseTo(-dot!);
    expect(find(".st-line")!.getAttribute("d")).toBe(`M0 ${dot}L0 ${knob}`);
  });

  test("with arrow keys drives in all four directions, and each part has a slider of its own", () => {
    const { find, does, box, take } = openDeck();
    does(() => press(find(".stick"), "ArrowUp"));
    expect(take("drive")).toMatchObject([{ vx: 2 }]);
    const [forward, left] = box.querySelectorAll<HTMLElement>(".stick [role=slider]");
    expect(forward!.getAttribute("aria-valuetext")).toBe("2.00 metres per second forward");
    expect(left!.getAttribute("aria-valuetext")).toBe("zero");
    does(() => lift(find(".stick"), "ArrowUp"));
    vi.advanceTimersByTime(20);
    does(() => press(left!, "ArrowRight"));
    expect(take("drive")).toMatchObject([{ vx: 0, vy: 2 }]);
    does(() => lift(left!, "ArrowRight"));
    expect(take("release")).toHaveLength(1);
  });

  test("of a robot that another drives, or that is silent, does not wait for arming", () => {
    const { state, pass, find, text } = openDeck();
    state({ mode: "driving", lease: { ...LEASE, holder: "bob" } }, { has_control: false });
    expect([find(".stick.off") !== null, text(".turn .lab:last-child")]).toEqual([true, "rad/s"]);
    state({ mode: "disarmed" });
    pass(500);
    expect([find(".stick.off") !== null, text(".turn .lab:last-child")]).toEqual([true, "rad/s"]);
  });

  test("says why it does not act, and is not drawn in a recording", () => {
    const { find, state, text } = openDeck();
    state({ mode: "disarmed", refusals: { why: { drive: { code: "arm_first" } } } });
    expect(find(".stick.off")?.title).toBe("The robot is disarmed: arm it first.");
    expect(text(".turn .lab:last-child")).toBe("when armed");
    state(STOPPED);
    expect(text(".turn .lab:last-child")).toBe("after the reset");
    state();
    expect([find(".stick.off"), find(".stick")?.title]).toEqual([null, ""]);
    state({}, { source: "recording" });
    expect([find(".stick"), find(".turn"), find(".headcell") !== null]).toEqual([null, null, true]);
  });

  test("shows x of the world, which is to the right of a robot that has turned left", () => {
    const { find, text, does, state, take } = openDeck();
    const place = (selector: string) =>
      find(selector)!
        .getAttribute("transform")!
        .match(/-?[\d.]+(e-\d+)?/g)!
        .slice(0, 2)
        .map((part) => Math.round(Number(part)) + 0); // Without a negative zero.
    state({}, { pose: [0, 0, Math.PI / 2] });
    expect([place(".world-x"), place(".st-front")]).toEqual([
      [41, 0],
      [0, -59],
    ]);
    does(() => find(".frame")!.click());
    expect(text(".frame")).toBe("axes of floor");
    expect([place(".world-x"), place(".st-front")]).toEqual([
      [0, -41],
      [-59, 0],
    ]);
    does(() => press(find(".stick"), "ArrowUp"));
    expect(take("drive")).toMatchObject([{ frame: "odom", vx: 2 }]);
    does(() => lift(find(".stick"), "ArrowUp"));
  });
});

test("the turn slider turns left on the left", () => {
  const { find, does, take, pass } = openDeck();
  const slider = find(".turn [role=slider]")!;
  place(slider, 216, 44);
  does(() => fire(slider, "pointerdown", { ...FINGER, clientX: 0 }));
  expect(take("drive")).toMatchObject([{ omega: 4 }]);
  expect(slider.getAttribute("aria-valuetext")).toBe("4.00 radians per second to the left");
  expect(Number(slider.style.getPropertyValue("--at"))).toBe(-0.5);
  does(() => fire(slider, "pointerup", FINGER));
  pass(20);
  does(() => press(slider, "ArrowRight"));
  expect(take("drive")).toMatchObject([{ omega: -4 }]);
  does(() => lift(slider, "ArrowRight"));
});

test("the speed limit is one continuous handle, and a held stick follows it", () => {
  const { find, does, drive, pass, take } = openDeck();
  const slider = find(".cap")!;
  place(slider, 200, 32);
  does(() => fire(slider, "pointerdown", { ...FINGER, clientX: 74 }));
  expect(drive.level.value).toBe(0.37);
  expect(slider.getAttribute("aria-valuetext")).toBe("0.74 metres per second");
  does(() => fire(slider, "pointerup", FINGER));
  does(() => press(find(".stick"), "ArrowUp"));
  does(() => press(slider, "ArrowRight"));
  pass(20);
  expect(take("drive").at(-1)).toMatchObject({ vx: 0.84 });
  for (const [key, level] of [
    ["Home", 0.05],
    ["End", 1],
  ] as const) {
    does(() => press(slider, key));
    expect(drive.level.value).toBe(level);
  }
  does(() => lift(find(".stick"), "ArrowUp"));
});

test("figures of a robot without a signal are not known", () => {
  const { text, find, state, pass } = openDeck();
  state({}, { pose: [3.456, 1.4, Math.PI / 6], twist: [0.3, 0.4, 0] });
  expect([text(".hero"), text(".headcell dl")]).toEqual(["0.50m/s", "Heading30°x3.46my1.40m"]);
  const drawn = () => [".st-dot", ".world-x", ".needle"].filter((each) => find(each) !== null);
  state({ mode: "driving" }, { pose: [3.456, 1.4, Math.PI / 6], commanded: [0.3, 0.4, 0] });
  expect(drawn()).toHaveLength(3);
  pass(500);
  expect(text(".headcell dl")).toBe("Heading–x–my–m");
  expect(drawn()).toEqual([]);
});

test("a sphere has figures of its own and no floor", () => {
  const { text, find, say, state, drive } = openDeck();
  drive.setFrame("odom");
  const half = Math.SQRT1_2;
  say({ ...ROBOT, space: "sphere", panel: "sphere", twist_scale_m: 0.1 });
  const sphere = { wxyz: [half, 0, half, 0] } as never;
  state({}, { pose: null, sphere, twist: [0, 3, 1] });
  expect([text(".hero"), text(".headcell dl")]).toEqual([
    "3.00rad/s",
    "Turned90°ωx0.00rad/sωy3.00rad/sωz1.00rad/s",
  ]);
  expect([find(".frame"), drive.frame.value]).toEqual([null, "base_link"]);
});

describe("the next step", () => {
  test("takes control, arms, and is reset by a key that is held for a second", () => {
    const { find, text, does, pass, state, take, link } = openDeck();
    const lease = { ...LEASE, holder: null };
    const use = () => does(() => find(".next")!.click());
    state({ mode: "disarmed", lease }, { has_control: false });
    find(".next")!.focus();
    use();
    expect(take("lease")).toEqual([{ t: "lease", op: "acquire", max_age_s: 0.11 }]);
    expect([find(".next")?.getAttribute("aria-busy"), text(".slot [role=status]")]).toEqual([
      "true",
      "Waiting for the robot.",
    ]);
    use();
    expect(take("lease")).toEqual([]);
    does(() => link.robot.peek() && state({ mode: "disarmed" }));
    expect(document.activeElement).toBe(find(".next"));
    use();
    expect(take("arm")).toHaveLength(1);
    state(STOPPED);
    const enter = { key: "Enter" };
    does(() => press(find(".next"), "Enter", enter));
    pass(900, STOPPED);
    does(() => lift(find(".next"), "Enter", enter));
    pass(900, STOPPED);
    expect(take("reset")).toEqual([]);
    does(() => press(find(".next"), "Enter", enter));
    pass(1000, STOPPED);
    expect(take("reset")).toHaveLength(1);
    state({ mode: "disarmed" });
    expect([document.activeElement, text(".next")]).toEqual([find(".next"), "Arm"]);
    does(() => press(find(".next"), "Enter", { ...enter, repeat: true }));
    does(() => lift(find(".next"), "Enter", enter));
    expect(take("arm")).toEqual([]);
  });

  test("that gets no answer says so", () => {
    const { find, text, does, pass, state } = openDeck();
    state({ mode: "disarmed" });
    does(() => find(".next")!.click());
    pass(2200, { mode: "disarmed" });
    expect(text(".slot [role=status]")).toBe("No answer.");
    does(() => find(".next")!.click());
    expect(text(".slot [role=status]")).toBe("Waiting for the robot.");
  });

  test("names people apart from the sentence, and hands over", () => {
    const { find, text, does, state, take } = openDeck();
    const lease = { ...LEASE, requested_by: "bob", request_expires_in_s: 5 };
    state({ mode: "driving", lease, operators: { bob: "محمد" } });
    expect(text(".slot b bdi")).toBe("محمد");
    does(() => find(".next")!.click());
    expect(take("lease")).toEqual([{ t: "lease", op: "grant", requester: "bob" }]);
  });

  test("holds a path while a finger or Enter is on it, until the page releases it", () => {
    const { find, does, state, session } = openDeck();
    const { going } = session.path;
    const route = { number: 1, phase: "planned", length_m: 3, time_s: 8, done_m: 0 } as RouteState;
    state({}, { route });
    const go = find(".next")!;
    const held = (change: () => void) => {
      does(change);
      return going.value;
    };
    expect(held(() => fire(go, "pointerdown", FINGER))).toBe(true);
    expect(held(() => fire(go, "lostpointercapture", FINGER))).toBe(false);
    expect(held(() => press(go, "Enter"))).toBe(true);
    expect(held(() => press(go, "Enter", { repeat: true }))).toBe(true);
    expect(held(() => fire(go, "blur"))).toBe(false);
    expect(held(() => press(go, "Enter"))).toBe(false);
    lift(go, "Enter");
    expect(held(() => press(go, "Enter"))).toBe(true);
    expect(held(() => lift(go, "Enter"))).toBe(false);
  });
});

test("a value that is kept shows in the deck", () => {
  const { text, does, drive } = openDeck();
  const source = { held: true, alone: true, share: { x: 0.1, y: 0, turn: 0 }, cancel() {} };
  does(() => {
    drive.add(source);
    drive.changed();
  });
  expect(text(".alone")).toContain("no hand on a control");
});

test("on the page of all robots the deck has no control but STOP ALL", () => {
  const { box, does, session } = openDeck();
  does(() => (session.layout.screen.value = "fleet"));
  const controls = [...box.querySelectorAll("button, [role=slider], [role=application]")];
  expect(controls.map((each) => each.textContent)).toEqual(["STOP ALL"]);
});

test.each([
  ["free", { mode: "disarmed", lease: { ...LEASE, holder: null } }],
  ["ready", {}],
  ["stopped", STOPPED],
  ["arming", { mode: "arming", arming: { phase: "hold", progress: 0.5 } }],
])("axe finds nothing in the deck of a robot that is %s", async (_, status) => {
  const { box, state } = openDeck();
  state(status, { has_control: !("lease" in status) });
  vi.useRealTimers();
  const { violations } = await axe.run(box, { rules: { region: { enabled: false } } });
  expect(violations.map(({ id, nodes }) => [id, nodes.map(({ html }) => html)])).toEqual([]);
});
