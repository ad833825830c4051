// Equations of the drive with the numbers of the setting, and where they come from.

import { type ComponentChild, h } from "preact";
import type { Equation, MathToken } from "../generated/wire";
import { figure } from "../text/numbers";
import { texts } from "../text/text";

export function Equations({ equations }: { equations: readonly Equation[] }) {
  const { student } = texts();
  return (
    <div class="eqs">
      {equations.map(({ name, formula, values, units, paper, equation, corrected }) => {
        const meaning = student.equations[name] ?? name.replaceAll("_", " ");
        const unit = [...new Set(units)].filter(Boolean).join(", ");
        return (
          <div key={name}>
            <math class="f">{formula.map(mathOf)}</math>
            <output>{values.map((value) => figure(value, decimalsOf(value))).join(" · ")}</output>
            <p class="note">
              {unit ? `${unit}: ${meaning}` : meaning}
              {paper && ` (${student.source(paper, equation, corrected)})`}
            </p>
          </div>
        );
      })}
    </div>
  );
}

/** Decimals for three or four digits. */
export function decimalsOf(value: number | null): number {
  const size = Math.abs(value ?? 0);
  return size >= 100 ? 0 : size >= 10 ? 1 : size >= 1 || size === 0 ? 2 : 3;
}

function mathOf({ kind, text, sub, sup, rows }: MathToken): ComponentChild {
  if (rows) return h(kind, null, ...rows.map((row) => h("mrow", null, ...row.map(mathOf))));
  const base = h(kind, kind === "mi" ? { mathvariant: "normal" } : null, text);
  const [below, above] = [sub && h("mi", null, sub), sup && h("mn", null, sup)];
  if (below && above) return h("msubsup", null, base, below, above);
  if (below) return h("msub", null, base, below);
  return above ? h("msup", null, base, above) : base;
}
