// A pane: the fields with their values, each a menu and a thing to drag, and the chart below.

import { useEffect, useRef } from "preact/hooks";
import { figure, texts } from "../text/text";
import { Menu } from "../ui/menu";
import { newChart, stylesOf } from "./chart";
import type { PlotField } from "./fields";
import { fits } from "./layout";
import type { PlotView } from "./view";

interface PaneProps {
  view: PlotView;
  fields: readonly PlotField[];
  /** Index in the layout. */
  at: number;
  isLast: boolean;
}

export function Pane({ view, fields, at, isLast }: PaneProps) {
  const place = useRef<HTMLDivElement>(null);
  const words = texts().plots;
  const titles = [...new Set(fields.map(({ title }) => words.titles[title] ?? title))].join(", ");
  const units = [...new Set(fields.map(({ unit }) => unit))].filter(Boolean).join(", ");
  const styles = stylesOf(fields);
  useEffect(() => {
    const chart = newChart(place.current!, fields, view, isLast);
    view.redraw();
    return () => chart.destroy();
  }, [isLast]); // Other fields are another pane.
  return (
    <figure class="chart" {...dropInto(view, at)}>
      <figcaption>
        <b>{titles}</b>
        <span class="u">{units}</span>
      </figcaption>
      <div class="legend">
        {fields.map((field, i) => (
          <Series key={field.name} view={view} field={field} style={styles[i]!} at={at} />
        ))}
      </div>
      <div ref={place} role="img" aria-label={`${titles} ${units}`} />
    </figure>
  );
}

interface SeriesProps {
  view: PlotView;
  field: PlotField;
  style: ReturnType<typeof stylesOf>[number];
  at: number;
}

function Series({ view, field, style, at }: SeriesProps) {
  const { recorder } = view;
  const words = texts().plots;
  const { panes } = recorder.layout.value;
  const { part, line, name } = field;
  const source = line === "other" ? name.split(".")[0] : "";
  const setPoint = line === "set" ? words.setPoint : "";
  const others = panes.map((pane, to) => ({
    text: words.moveTo(to + 1),
    refused: fits(pane, field, recorder.known.value) ? null : words.twoUnits,
    onChoose: () => recorder.move(name, to),
  }));
  const items = [
    ...others.toSpliced(at, 1),
    { text: words.moveToNew, onChoose: () => recorder.move(name, panes.length) },
    { text: words.removeField, onChoose: () => recorder.move(name, null) },
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
      {[source, part, setPoint].filter(Boolean).join(" ")} <Value view={view} field={field} />
    </>
  );
  return (
    <span class="series" title={name} {...dragOf(view, name)}>
      <Menu named label={words.fieldMenu(name)} button={button} items={items} />
    </span>
  );
}

function Value({ view, field }: { view: PlotView; field: PlotField }) {
  return <span class="value">{figure(view.value(field.name), field.decimals)}</span>;
}

/** Handlers of a thing that stands for a field and can be dragged. */
export function dragOf(view: PlotView, name: string) {
  return {
    draggable: true,
    onDragStart: (event: DragEvent) => {
      event.dataTransfer?.setData("text/plain", name);
      view.dragged.value = name;
    },
    onDragEnd: () => (view.dragged.value = null),
  };
}

/** Handlers of a pane to which a dragged field moves. */
export function dropInto(view: PlotView, to: number) {
  const { recorder } = view;
  const { known, layout } = recorder;
  return {
    onDragOver: (event: DragEvent) => {
      const field = known.peek().get(view.dragged.peek() ?? "");
      const pane = layout.peek().panes[to] ?? [];
      if (field && fits(pane, field, known.peek())) event.preventDefault();
    },
    onDrop: (event: DragEvent) => {
      event.preventDefault();
      const name = view.dragged.peek();
      view.dragged.value = null;
      if (name !== null) recorder.move(name, to);
    },
  };
}
