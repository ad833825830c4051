// A value and its unit, smaller and paler.

import { figure } from "../text/numbers";

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
