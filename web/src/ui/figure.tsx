// A value and its unit, smaller and paler.

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
      {unit && <span class="u">{unit}</span>}
    </>
  );
}
