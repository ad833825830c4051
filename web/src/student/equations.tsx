// Equations of the drive with the numbers of the setting, and where they come from.

import { type ComponentChild, h } from "preact";
import type { Equation, MathToken } from "../generated/wire";
import { figure } from "../text/numbers";
import { texts } from "../text/text";

export function Equations({ equations }: { equations: readonly Equation[] }) {
  return (
    <div class="eqs">
      {equations.map((equation) => (
        <EquationCell key={equation.name} equation={equation} />
      ))}
    </div>
  );
}

function EquationCell({ equation }: { equation: Equation }) {
  const { student } = texts();
  const { formula, values, name, paper, units } = equation;
  const meaning = student.equations[name] ?? name.replaceAll("_", " ");
  const unit = [...new Set(units)].filter(Boolean).join(", ");
  return (
    <div>
      <math class="f">{formula.map(mathOf)}</math>
      <output>{values.map((value) => figure(value, decimalsOf(value))).join(" · ")}</output>
      <p class="note">
        {unit ? `${unit}: ${meaning}` : meaning}
        {paper && ` (${student.source(paper, equation.equation, equation.corrected)})`}
      </p>
    </div>
  );
}

/** Decimals for three or four digits. */
export function decimalsOf(value: number | null): number {
  const size = Math.abs(value ?? 0);
  return size >= 100 ? 0 : size >= 10 ? 1 : size >= 1 || size === 0 ? 2 : 3;
}

function mathOf(token: MathToken, key: number): ComponentChild {
  const { kind, sub, sup, rows } = token;
  if (rows) {
    const parts = rows.map((row, i) => h("mrow", { key: i }, row.map(mathOf)));
    return h(kind, { key }, parts);
  }
  const base = h(kind, kind === "mi" ? { key, mathvariant: "normal" } : { key }, token.text);
  if (sub && sup) return h("msubsup", { key }, base, h("mi", null, sub), h("mn", null, sup));
  if (sub) return h("msub", { key }, base, h("mi", null, sub));
  return sup ? h("msup", { key }, base, h("mn", null, sup)) : base;
}
