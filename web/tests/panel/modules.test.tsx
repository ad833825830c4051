import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { fakeBrowser, fire } from "../support/page";
import { GIMBALS, openPanel } from "../support/panel";

beforeEach(fakeBrowser);
afterEach(() => void vi.useRealTimers());

const POSE = { alpha: 3, beta: 4, tilt: 5, direction: 90, axle: [0, 0.2], push: [0.3, 0.4] };
const GOAL = { ...POSE, alpha: 3.1, tilt: 6.5, rpm: 2400 };
const MODULE = {
  ...POSE,
  rpm: 2390,
  radius_mm: 39.8,
  spinning: true,
  setpoint: GOAL,
};
const AGREE = { residual_mps: 0.004, suspect: null, level: 0.1, contributions: { module2: 0.25 } };
const LIMITS = {
  speed_mps: 2,
  turn_rate_rad_per_s: 4,
  max_command_age_s: 0.25,
  applied: 1,
  why: [],
};
function openGimbals(consistency = {}, module = {}, status = {}) {
  const panel = openPanel();
  const show = (more = {}) =>
    panel.state(
      { consistency: { ...AGREE, ...consistency }, ...status, ...more },
      { modules: [MODULE, { ...MODULE, ...module }, MODULE] as never, utilization: 0.15 },
    );
  show();
  panel.pass(120);
  return { ...panel, show };
}

test("The Drive tab shows the set-points of the modules and the share of the tilt in use.", () => {
  const { text, find } = openGimbals();
  const row = (name: string) =>
    [...find(".mods").querySelectorAll("tr")].find((tr) => tr.textContent.startsWith(name))!;
  expect(row("tilt").textContent).toBe("tilt6.5°6.5°6.5°");
  expect(row("push").textContent).toBe("push0.50m/s0.50m/s0.50m/s");
  expect(row("wheel").textContent).toContain("2,400rpm");
  expect(text("thead")).toContain("ring 10°");
  expect(text(".used")).toContain("15 %");
});

test("The limit that holds the robot back is named, with the reasons of a lower speed.", () => {
  const { text, state } = openGimbals();
  const why = [{ code: "limited", params: { percent: 50 } }];
  state({ mode: "driving", limits: { ...LIMITS, why } }, { limit: "speed" });
  expect(text(".held")).toContain("The speed limit holds the robot back.");
  expect(text(".held")).toContain("50 %");
  state({ mode: "driving" }, { limit: null });
  expect(text(".held")).toBe("Nothing is held back: the robot does what you ask.");
});

test("Figures of a silent robot are not shown as current.", () => {
  const { text, pass, find, click } = openGimbals();
  pass(1000);
  expect(text(".mods")).not.toMatch(/\d\.\d/);
  expect(find(".d-dot")).toBeNull();
  click("Modules");
  expect(text(".modules")).not.toMatch(/\d\.\d/);
});

test("The Modules tab compares measured values and set-points, and says that all agree.", () => {
  const { text, click } = openGimbals();
  click("Modules");
  expect(text(".modules section:nth-child(2)")).toContain("tilt5.0°6.5°");
  expect(text(".modules section:nth-child(2)")).toContain("share of the residual25%");
  expect(text(".body")).toContain("The modules agree.");
  expect(text(".body")).toContain("0.004m/s");
});

test("A suspect is named, with the gimbal that does not follow and what ends its push.", () => {
  const { text, click, show, pass, box } = openGimbals({ suspect: "module2" }, { beta: 7.2 });
  click("Modules");
  expect(text(".sec.suspect")).toContain("Module 2 does not follow: its gimbal β is 3.2°");
  expect(text(".sec.suspect")).toContain("STOP shuts the wheels off.");
  expect(box.querySelectorAll(".modules .suspect")).toHaveLength(1);
  show({ mode: "stopped" });
  pass(120);
  expect(text(".sec.suspect")).toContain("The wheels are shut off.");
});

const SPEEDS = {
  least_rpm: 1000,
  most_rpm: 4000,
  default_rpm: 2500,
  wheel_radius_m: 0.04,
  servo_step_deg: 0.3,
};

function openSpeed() {
  const panel = openPanel();
  panel.say({ ...GIMBALS, max_tilt_deg: 30, wheel_speed_limits: SPEEDS });
  const show = (requested_rpm: number, spin_rpm = requested_rpm, more = {}) =>
    panel.state({ wheel_speed: { requested_rpm, spin_rpm }, ...more });
  show(2500);
  panel.take();
  const field = (label: string) => panel.find(`input[aria-label="${label}"]`) as HTMLInputElement;
  const edit = (label: string, value: string, done = true) =>
    panel.does(() => {
      const input = field(label);
      input.value = value;
      fire(input, "input");
      if (done) fire(input, "change");
    });
  return { ...panel, show, field, edit };
}

test("A wheel speed is asked for within its limits, one at a time, the latest last.", () => {
  const { edit, take, say } = openSpeed();
  edit("Wheel speed in rpm", "9000");
  expect(take()).toEqual([{ t: "wheel_speed", cruise_speed_rpm: 4000 }]);
  edit("Wheel speed", "3000");
  edit("Wheel speed", "3500");
  expect(take()).toEqual([]);
  say({ t: "reply", to: "wheel_speed", ok: true, why: null });
  expect(take()).toEqual([{ t: "wheel_speed", cruise_speed_rpm: 3500 }]);
});

test("A speed over the floor asks for the slowest wheels that reach it.", () => {
  const { edit, take } = openSpeed();
  edit("Wheel speed for up to this many m/s", "5");
  const rim = (5 / Math.sin(Math.PI / 6) / 0.04) * (30 / Math.PI);
  expect(take()).toEqual([{ t: "wheel_speed", cruise_speed_rpm: Math.ceil(rim) }]);
});

test("While a number is typed nothing is asked for, and states do not overwrite it.", () => {
  const { edit, take, show, field } = openSpeed();
  edit("Wheel speed in rpm", "31", false);
  show(2600);
  expect(field("Wheel speed in rpm").value).toBe("31");
  expect(take()).toEqual([]);
});

test("A refused wheel speed gives way to the one in force.", () => {
  const { edit, say, field, pass, show } = openSpeed();
  edit("Wheel speed in rpm", "3000");
  expect(field("Wheel speed").value).toBe("3000");
  say({ t: "reply", to: "wheel_speed", ok: false, why: { code: "limited", params: {} } });
  pass(1600);
  show(2500);
  pass(120);
  expect(field("Wheel speed").value).toBe("2500");
});

test("Without permission the wheel speed cannot be edited, and the reason is shown.", () => {
  const { state, field, text } = openSpeed();
  state({ wheel_speed: { requested_rpm: 2500, spin_rpm: 0 } }, { has_control: false });
  expect(field("Wheel speed").disabled).toBe(true);
  expect(text(".foldable:last-child [role=status]")).not.toBe("");
});

const WHEEL = {
  rpm: 20,
  rpm_setpoint: 30,
  residual_mps: 0,
  push: [0.1, 0],
  push_setpoint: [0.2, 0],
};

test("Wheels are compared in one table, which marks the suspect.", () => {
  const { say, state, click, pass, text, find } = openPanel();
  say({ ...GIMBALS, panel: "wheels", modules: [], wheels: ["a", "b", "c", "d"] });
  const show = (suspect: string | null) =>
    state(
      { consistency: { ...AGREE, suspect } },
      { wheels: [WHEEL, WHEEL, { ...WHEEL, rpm: -5, residual_mps: 0.12 }, WHEEL] as never },
    );
  show("c");
  click("Modules");
  pass(100);
  expect(text("tbody tr:nth-child(3)")).toBe("Wheel 3−5rpm30rpm0.120m/s");
  expect(find(".mods .suspect").textContent).toBe("Wheel 3");
  expect(text(".body")).toContain("Wheel 3 contradicts the others.");
  show(null);
  pass(100);
  expect(text(".body")).toContain("The wheels agree.");
  expect(find(".suspect")).toBeNull();
});

test("A mark of a sphere is drawn where it is seen from above, and can be brought up.", () => {
  const { say, state, click, pass, find, take } = openPanel();
  const [front, up] = [".mark.front", ".mark.top"];
  say({ ...GIMBALS, panel: "sphere", space: "sphere", modules: [] });
  const ideal = [0, 0, 0];
  const show = (wxyz: number[]) =>
    state({}, { sphere: { wxyz, ideal, dual: null, angle_deg: null, rows: [] } as never });
  show([1, 0, 0, 0]);
  click("Modules");
  pass(100);
  expect([find(front).getAttribute("cx"), find(front).getAttribute("cy")]).toEqual(["0", "-36"]);
  const half = Math.SQRT1_2;
  show([half, 0, half, 0]); // Rolled forward by a quarter: what was on top is in front.
  pass(100);
  expect(Number(find(up).getAttribute("cy"))).toBeCloseTo(-36);
  take();
  click("Top");
  pass(20);
  const { vx, vy } = take("drive").at(-1)!;
  expect(vx).toBeCloseTo(0);
  expect(vy).toBeLessThan(0);
});
