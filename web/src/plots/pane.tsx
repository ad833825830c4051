// A pane: the fields with their values, each a menu and a thing to drag, and the chart below.

import { useEffect, useRef } from "preact/hooks";
import { useSession } from "../session";
import { freshness, isCurrent } from "../store/freshness";
import { figure } from "../text/numbers";
import { texts } from "../text/text";
import { Menu } from "../ui/menu";
import { PlotChart, stylesOf, type LineStyle } from "./chart";
import { decimalsOf, type PlotField } from "./fields";
import { fits, moved } from "./layout";
import type { Shared } from "./plots";

interface PaneProps {
  shared: Shared;
  fields: readonly PlotField[];
  /** Index in the layout. */
  at: number;
  isLast: boolean;
}

export function Pane({ shared, fields, at, isLast }: PaneProps) {
  const place = useRef<HTMLDivElement>(null);
  const words = texts().plots;
  const titles = [...new Set(fields.map(({ title }) => words.titles[title] ?? title))];
  const units = [...new Set(fields.map(({ unit }) => unit))].filter(Boolean);
  const styles = stylesOf(fields);
  useEffect(() => {
    const chart = new PlotChart(place.current!, fields, shared.view, isLast);
    shared.charts.add(chart);
    shared.redraw();
    return () => {
      shared.charts.delete(chart);
      chart.plot.destroy();
    };
  }, [isLast]); // Other fields are another pane.
  return (
    <figure class="chart" {...useDrop(shared, at)}>
      <figcaption>
        <b>{titles.join(", ")}</b>
        <span class="u">{units.join(", ")}</span>
      </figcaption>
      <div class="legend">
        {fields.map((field, i) => (
          <Series key={field.name} shared={shared} field={field} style={styles[i]!} at={at} />
        ))}
      </div>
      <div ref={place} role="img" aria-label={`${titles.join(", ")} ${units.join(", ")}`} />
    </figure>
  );
}

/** Handlers of a place to which a dragged field moves. */
function useDrop(shared: Shared, to: number) {
  const { recorder } = useSession();
  const dragged = () => recorder.known.peek().get(shared.dragged.value ?? "");
  const accepts = () => {
    const field = dragged();
    const pane = recorder.layout.peek().panes[to] ?? [];
    return field !== undefined && fits(pane, field, recorder.known.peek());
  };
  return {
    onDragOver: (event: DragEvent) => accepts() && event.preventDefault(),
    onDrop: (event: DragEvent) => {
      event.preventDefault();
      const layout = recorder.layout.peek();
      const name = shared.dragged.value;
      shared.dragged.value = null;
      if (name) recorder.choose({ ...layout, panes: moved(layout.panes, name, to) });
    },
  };
}

/** Place for a field that should get a pane of its own, while one is dragged. */
export function DropPane({ shared }: { shared: Shared }) {
  const { recorder } = useSession();
  const drop = useDrop(shared, recorder.layout.value.panes.length);
  if (shared.dragged.value === null) return null;
  return (
    <div class="drop" {...drop}>
      {texts().plots.newPane}
    </div>
  );
}

interface SeriesProps {
  shared: Shared;
  field: PlotField;
  style: LineStyle;
  at: number;
}

function Series({ shared, field, style, at }: SeriesProps) {
  const { recorder } = useSession();
  const words = texts().plots;
  const { known, layout } = recorder;
  const { panes } = layout.value;
  const { part, line, name } = field;
  const prefix = line === "other" ? `${name.split(".")[0]} ` : "";
  const label = `${prefix}${part}${line === "set" ? ` ${words.setPoint}` : ""}`;
  const move = (to: number | null) =>
    recorder.choose({ ...layout.peek(), panes: moved(panes, name, to) });
  const others = panes.map((pane, to) => ({
    text: words.moveTo(to + 1),
    refused: fits(pane, field, known.value) ? null : words.twoUnits,
    onChoose: () => move(to),
  }));
  const items = [
    ...others.filter((_, to) => to !== at),
    { text: words.moveToNew, onChoose: () => move(panes.length) },
    { text: words.removeField, onChoose: () => move(null) },
  ];
  const button = (
    <>
      <svg class="line" viewBox="0 0 24 4" aria-hidden="true">
        <path
          d="M0 2H24"
          style={{ stroke: `var(${style.hue})` }}
          stroke-width={style.width}
          stroke-dasharray={style.dash.join(" ")}
        />
      </svg>
      {label} <Value shared={shared} field={field} />
    </>
  );
  return (
    <span class="series" title={name} {...useDrag(shared, name)}>
      <Menu named label={words.fieldMenu(name)} button={button} items={items} />
    </span>
  );
}

export function useDrag(shared: Shared, name: string) {
  return {
    draggable: true,
    onDragStart: (event: DragEvent) => {
      event.dataTransfer?.setData("text/plain", name);
      shared.dragged.value = name;
    },
    onDragEnd: () => (shared.dragged.value = null),
  };
}

/** Value at the cursor, or the latest one while it is current. */
function Value({ shared, field }: { shared: Shared; field: PlotField }) {
  const { recorder, link } = useSession();
  const { view, frame } = shared;
  void [frame.value, link.beat.value];
  const known = view.cursorS.value !== null || view.endS.value !== null;
  const shown = known || isCurrent(freshness(link));
  const value = shown ? recorder.buffer.values(field.name)[view.index()] : null;
  return <span class="value">{figure(value, decimalsOf(field))}</span>;
}
