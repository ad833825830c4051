// A value and its unit, smaller and paler; an unknown value has none.

import { figure } from "../text/numbers";

/** Symbol of a quantity, such as v with the subscript x. */
export function Quantity({ symbol }: { symbol: string }) {
  return (
    <>
      {symbol.slice(0, 1)}
      {symbol.length > 1 && <sub>{symbol.slice(1)}</sub>}
    </>
  );
}

interface FigureProps {
  value: number | null | undefined;
  decimals?: number;
  unit?: string;
  sign?: boolean;
}

export function Figure({ value, decimals = 0, unit, sign }: FigureProps) {
  return (
    <>
      {figure(value, decimals, sign)}
      {unit && typeof value === "number" && <span class="u">{unit}</span>}
    </>
  );
}
