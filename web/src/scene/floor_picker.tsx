// Layer over the picture that takes clicks and lines on the floor, and shows them. The picture is in
// a frame of another origin, so no pointer of it reaches the page.

import { effect } from "@preact/signals";
import { useEffect, useMemo, useRef } from "preact/hooks";
import { HeldPointer } from "../drive/held";
import { useSession } from "../session";
import { GoalMark } from "./map_picture";
import type { Pixel } from "./map_view";
import { Picker } from "./picker";

export function FloorPicker() {
  const { path } = useSession();
  // While the robot follows a path, the picture takes the pointer, and the camera can be moved.
  return path.mode.value === "stick" || path.going.value ? null : <Layer />;
}

function Layer() {
  const { path, view } = useSession();
  const layer = useRef<HTMLDivElement>(null);
  const picker = useMemo(() => {
    const size = (): Pixel => [layer.current?.clientWidth || 1, layer.current?.clientHeight || 1];
    return new Picker(path, {
      on: "picture",
      toPlace: ([x, y]) => [fraction(x / size()[0]), fraction(y / size()[1])],
      toPixel: ([x, y]) => [x * size()[0], y * size()[1]],
    });
  }, [path]);
  useEffect(() => {
    const node = layer.current!;
    const placeOf = ({ clientX, clientY }: PointerEvent): Pixel => {
      const { left, top } = node.getBoundingClientRect();
      return [clientX - left, clientY - top];
    };
    const pointer = new HeldPointer(node, {
      came: (event) => picker.begin(placeOf(event)),
      moved: (event) => picker.move(placeOf(event)),
      gone: ({ type }) => (type === "pointerup" ? picker.finish() : picker.cancel()),
    });
    // Another camera or size gives the pixels other places.
    const forget = () => {
      if (path.wish.peek()?.on === "picture") path.wish.value = null;
    };
    let first = true;
    const watched = effect(() => {
      if (view.settings.value && !first) forget();
      first = false;
    });
    const resized = new ResizeObserver(() => !first && forget());
    resized.observe(node);
    return () => {
      pointer.end();
      watched();
      resized.disconnect();
    };
  }, [picker, path, view]);
  const goal = picker.goal();
  const line = picker.line();
  return (
    <div ref={layer} class="floor-picker" aria-hidden="true">
      <svg>
        <polyline class="pick-line" points={line.map((point) => point.join()).join(" ")} />
        {goal && <GoalMark goal={goal} />}
      </svg>
    </div>
  );
}

function fraction(share: number): number {
  return Number(Math.max(0, Math.min(1, share)).toFixed(5));
}
