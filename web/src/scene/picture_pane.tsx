// Pane with the picture of a camera: an inset that can be moved, or the main view.

import { useEffect, useRef } from "preact/hooks";
import { useSession } from "../session";
import { figure, texts } from "../text/text";
import { Button } from "../ui/button";
import { Icon } from "../ui/icon";
import { LATE_MS, OLD_MS, type PictureFeed } from "./picture_feed";

const STEP_PX = 24;
const ARROWS: Record<string, [number, number]> = {
  ArrowLeft: [-STEP_PX, 0],
  ArrowRight: [STEP_PX, 0],
  ArrowUp: [0, -STEP_PX],
  ArrowDown: [0, STEP_PX],
};

export function PicturePane() {
  const { pictures, link, layout } = useSession();
  const hasNoInset = layout.narrow.value || layout.sideways.value;
  const { pictures: words } = texts().scene;
  const camera = pictures.camera.value;
  if (camera === null || link.recording !== null) return null;
  if (!pictures.open.value)
    return (
      <button
        type="button"
        class="chip"
        aria-expanded="false"
        data-covers
        onClick={() => {
          pictures.toggle();
          pictures.main.value = hasNoInset;
        }}
      >
        <Icon name="camera" />
        {words.label}
      </button>
    );
  const isMain = pictures.main.value;
  return (
    <section class="pictures" aria-label={words.label} data-covers={isMain ? undefined : true}>
      <Handle fixed={isMain}>
        <Icon name="camera" />
        <Choice pictures={pictures} />
        <Age pictures={pictures} />
        {!(isMain && hasNoInset) && (
          <Button
            icon="expand"
            label={isMain ? words.smaller : words.larger}
            onPress={() => (pictures.main.value = !isMain)}
          />
        )}
        <Button icon="close" label={words.close} onPress={() => pictures.toggle()} />
      </Handle>
      <Picture pictures={pictures} />
    </section>
  );
}

function Choice({ pictures }: { pictures: PictureFeed }) {
  const { pictures: words } = texts().scene;
  const shown = pictures.camera.value!;
  const all = pictures.seen.value;
  if (all.length < 2) return <span class="spacer">{shown.name}</span>;
  return (
    <select
      class="spacer"
      aria-label={words.choose}
      value={shown.key}
      onChange={(event) => pictures.choose(event.currentTarget.value)}
    >
      {all.map(({ key, name }) => (
        <option key={key} value={key}>
          {name}
        </option>
      ))}
    </select>
  );
}

function Age({ pictures }: { pictures: PictureFeed }) {
  const { pictures: words } = texts().scene;
  void pictures.link.beat.value;
  const ageMs = pictures.ageMs();
  const isOld = ageMs > OLD_MS;
  const text = isOld
    ? words.none(figure(ageMs / 1000))
    : pictures.isShown && words.age(figure(Math.round(ageMs)));
  return (
    <>
      <span class={ageMs > LATE_MS ? "age late" : "age"}>{text}</span>
      <span class="sr" role="status">
        {isOld ? words.stopped : ""}
      </span>
    </>
  );
}

function Picture({ pictures }: { pictures: PictureFeed }) {
  const canvas = useRef<HTMLCanvasElement>(null);
  void pictures.link.beat.value;
  useEffect(() => {
    pictures.widthPx = canvas.current!.clientWidth * devicePixelRatio;
  });
  useEffect(() => pictures.drawOn(canvas.current!), [pictures]);
  const outlines = pictures.outlines.value;
  return (
    <div class={pictures.ageMs() > OLD_MS ? "frame old" : "frame"}>
      <canvas ref={canvas} role="img" aria-label={texts().scene.pictures.picture} />
      {outlines && (
        <svg viewBox={`0 0 ${outlines.size[0]} ${outlines.size[1]}`} aria-hidden="true">
          {outlines.tags.map(({ corners, robot, refused }, i) => (
            <g key={i} class={refused === null && robot !== null ? "tag" : "tag unused"}>
              <polygon points={corners.join(" ")} />
              <text x={corners[0]?.[0]} y={(corners[0]?.[1] ?? 0) - 8}>
                {robot}
              </text>
            </g>
          ))}
        </svg>
      )}
    </div>
  );
}

/** Header by which the pane is dragged, or moved with arrow keys. */
function Handle({ fixed, children }: { fixed: boolean; children: preact.ComponentChildren }) {
  const grip = useRef<HTMLElement>(null);
  const at = useRef<[number, number]>([0, 0]);
  const move = (right: number, down: number) => {
    const pane = grip.current!.parentElement!;
    const view = pane.offsetParent!.parentElement!.getBoundingClientRect();
    const box = pane.getBoundingClientRect();
    const within = (by: number, least: number, most: number) => Math.max(least, Math.min(most, by));
    at.current = [
      at.current[0] + within(right, view.left - box.left, view.right - box.right),
      at.current[1] + within(down, view.top - box.top, view.bottom - box.bottom),
    ];
    pane.style.translate = at.current.map((px) => `${px}px`).join(" ");
  };
  useEffect(() => {
    at.current = [0, 0];
    grip.current!.parentElement!.style.translate = "";
  }, [fixed]);
  if (fixed) return <header ref={grip}>{children}</header>;
  return (
    <header
      ref={grip}
      tabIndex={0}
      role="group"
      aria-label={texts().scene.pictures.move}
      onKeyDown={(event) => {
        const step = ARROWS[event.key];
        if (step === undefined || event.target !== grip.current) return;
        event.preventDefault();
        event.stopPropagation();
        move(...step);
      }}
      onPointerDown={(event) =>
        event.target === grip.current && grip.current!.setPointerCapture(event.pointerId)
      }
      onPointerMove={(event) =>
        grip.current!.hasPointerCapture(event.pointerId) && move(event.movementX, event.movementY)
      }
    >
      {children}
    </header>
  );
}
