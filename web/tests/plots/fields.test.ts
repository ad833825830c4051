import { expect, test } from "vitest";
import { stylesOf } from "../../src/plots/chart.ts";
import { fieldsOf, valueOf } from "../../src/plots/fields.ts";
import { ROBOT, STATE, statusOf } from "../support/fake_link.ts";

const FIELDS = fieldsOf(ROBOT, STATE);

test("Every number of a state is a field with a unit, and its name leads to its value.", () => {
  const state = { ...STATE, status: statusOf(), link: { round_trip_ms: 12 } };
  const fields = fieldsOf(ROBOT, state);
  const expected: Record<string, [string, number, string]> = {
    "pose.x": ["m", 1, "Position"],
    "pose.heading": ["rad", 0.5, "Heading"],
    "twist.vy": ["m/s", 0.2, "Velocity"],
    "commanded.vy": ["m/s", 0.5, "Velocity"],
    "commanded.omega": ["rad/s", 0.6, "Turn rate"],
    "modules.module2.alpha": ["°", 4, "Alpha"],
    "modules.module2.setpoint.alpha": ["°", 5, "Alpha"],
    "modules.module2.setpoint.axle.y": ["", 0.1, "Axle y"],
    "modules.module1.rpm": ["rpm", 2500, "Rpm"],
    "status.consistency.residual_mps": ["m/s", 0.012, "Consistency residual"],
    "status.consistency.contributions.module1": ["", 0.3, "Contributions module1"],
    "status.hardware.battery_v": ["V", 12.3, "Hardware battery"],
    "status.hardware.pulse_us.2": ["µs", 1501, "Pulse us 2"],
    "link.round_trip_ms": ["ms", 12, "Link round trip"],
  };
  for (const [name, [unit, value, title]] of Object.entries(expected)) {
    const field = fields.get(name);
    expect([name, field?.unit, field?.title]).toEqual([name, unit, title]);
    expect(valueOf(field, state)).toBe(value);
  }
  const refused = /kind|suspect|robot_s|truth/;
  expect([...fields.keys()].filter((name) => refused.test(name))).toEqual([]);
});

test.each([
  ["commanded.vx", "twist.vx"],
  ["requested.vx_mps", "twist.vx"],
  ["modules.module1.setpoint.alpha", "modules.module1.alpha"],
  ["modules.module2.setpoint.axle.y", "modules.module2.axle.y"],
])("%s has title, unit and part of %s, and another line.", (set, measured) => {
  const [a, b] = [FIELDS.get(set)!, FIELDS.get(measured)!];
  expect([a.title, a.unit, a.part]).toEqual([b.title, b.unit, b.part]);
  expect(a.line).not.toBe(b.line);
});

test("Lines of a plot differ by pattern or width, not by colour alone.", () => {
  const names = ["twist.vx", "twist.vy", "twist.omega", "requested.vx_mps", "commanded.vx"];
  const styles = stylesOf(names.map((name) => FIELDS.get(name)!));
  const looks = styles.map(({ dash, width }) => `${dash.join()} ${width}`);
  expect(new Set(looks).size).toBe(names.length);
  expect(styles[4]!.hue).toBe(styles[0]!.hue);
});
