// A value and its unit, smaller and paler.

import { figure } from "../text/text";

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
}

export function Figure({ value, decimals = 0, unit }: FigureProps) {
  return (
    <>
      {figure(value, decimals)}
      {unit && <span class="u">{unit}</span>}
    </>
  );
}
