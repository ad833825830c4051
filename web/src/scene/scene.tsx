// The main view: the 3D picture in its frame, and its corners. It stays behind the page
// of all robots, because the picture takes seconds to start.

import { effect, signal } from "@preact/signals";
import { useEffect, useMemo, useRef, useState } from "preact/hooks";
import { CAMERA_PRESETS } from "../generated/wire";
import { type Session, useSession } from "../session";
import { freshness, isCurrent } from "../store/freshness";
import { refusalText } from "../text/reasons";
import { texts } from "../text/text";
import { Outline, Portrait } from "../ui/portrait";
import { Viewport } from "../viewport/frame";
import { Cameras, Legend, Modes, RimArrow } from "./corners";
import { type Report, watchFreeRectangle } from "./free_rectangle";
import { FloorMap, MapInset } from "./map";
import { PicturePicker } from "./pick";
import "./scene.css";

const hidden = signal(document.hidden);
document.addEventListener("visibilitychange", () => (hidden.value = document.hidden));

export function Scene() {
  const session = useSession();
  const view = useRef<HTMLElement>(null);
  const map = useMemo(() => new FloorMap(session), [session]);
  const isCovered = session.layout.screen.value === "fleet";
  const byCamera = session.pictures.main.value;
  useEffect(() => {
    session.path.onRefused = (refusal, holds) => session.notice.say(refusalText(refusal), holds);
    const ends = [
      bindKeys(session, map),
      watchFreeRectangle(view.current!.firstElementChild!, reportTo(session)),
    ];
    return () => ends.forEach((end) => end());
  }, [session, map]);
  return (
    <main
      ref={view}
      class={`view scene-view${isCovered ? " covered" : ""}${byCamera ? " by-camera" : ""}`}
      aria-label={texts().scene.region}
      aria-hidden={isCovered || undefined}
    >
      <Picture isCovered={isCovered} />
      <PicturePicker />
      {!byCamera && <Modes />}
      <Cameras />
      <MapInset map={map} />
      <Legend />
      <RimArrow />
      <NoticeLine />
    </main>
  );
}

/** The frame of the picture; grey once it is not current; the deck says since when. */
function Picture({ isCovered }: { isCovered: boolean }) {
  const session = useSession();
  const host = useRef<HTMLDivElement>(null);
  const [viewport, setViewport] = useState<Viewport | null>(null);
  useEffect(() => {
    const { link, view, keyboard, sphere } = session;
    const made = new Viewport(host.current!, {
      page: link.page,
      recording: link.recording,
      dark: view.dark.peek(),
      title: texts().scene.picture,
      onKey: ({ code, key, mods }) => {
        const modified = mods.ctrl || mods.alt || mods.meta;
        keyboard.takeForwarded({ type: "keydown", code, key, repeat: false, modified });
      },
      onPointer: () => sphere.clicked(),
      isComplete: () => (link.state.peek()?.camera ?? null) !== null,
    });
    setViewport(made);
    const end = effect(() => {
      const share = { full: 1, half: 0.5, auto: null }[view.sharpness.value];
      if (share !== null) made.setSharpness(share);
    });
    return () => {
      end();
      made.dispose();
    };
  }, [session]);
  const rests = isCovered || hidden.value;
  useEffect(() => viewport?.pause(rests), [viewport, rests]);
  const software = viewport?.software.value ?? false;
  useEffect(() => void (session.pictures.software = software), [session, software]);
  const fresh = freshness(session.link);
  const isOld = viewport?.ready.value && !isCurrent(fresh) && fresh.kind !== "starting";
  return (
    <>
      <div ref={host} class={isOld ? "picture-host old" : "picture-host"} />
      {viewport && !viewport.ready.value && <Splash viewport={viewport} />}
    </>
  );
}

function NoticeLine() {
  const { notice } = useSession();
  return (
    <div class="notice-line" role="status">
      {notice.text.value !== null && (
        <p class="notice" title={notice.text.value}>
          <span>{notice.text.value}</span>
        </p>
      )}
    </div>
  );
}

function bindKeys({ keyboard, view }: Session, map: FloorMap): () => void {
  const cameras = CAMERA_PRESETS.flatMap((camera, i) =>
    ["Digit", "Numpad"].map((key) => [`${key}${i + 1}`, () => view.set({ camera }, true)]),
  );
  return keyboard.bind({ ...Object.fromEntries(cameras), KeyN: () => map.toggle() });
}

/** Send the free rectangle when it changes, and to each new connection. */
function reportTo({ link, layout }: Session): Report {
  let sent = "";
  let to: unknown = null;
  return (free, picture_px) => {
    const connection = link.welcome.peek();
    const text = JSON.stringify([free, picture_px]);
    if (connection === null || layout.screen.peek() === "fleet") return;
    if (text === sent && connection === to) return;
    if (link.send({ t: "frame", ...free, picture_px })) [sent, to] = [text, connection];
  };
}

const STEPS = ["connecting", "robot", "loading", "drawing"] as const;
const SLOW_MS = 30_000; // Without WebGL it never appears.

/**
 * Start of the view until the scene is drawn: the robot's portrait, its name, and the progress. It
 * does not block STOP.
 */
function Splash({ viewport }: { viewport: Viewport }) {
  const { library, link } = useSession();
  const { splash } = texts().scene;
  const [slow, setSlow] = useState(false);
  useEffect(() => {
    const timer = setTimeout(() => setSlow(true), SLOW_MS);
    return () => clearTimeout(timer);
  }, []);
  const robot = link.robot.value;
  const at = [link.connected.value, robot !== null, viewport.loaded.value, false].indexOf(false);
  const { common, timeline } = texts();
  const refusal = library.isMissing.value
    ? timeline.refusals["no_recording"]
    : freshness(link).kind === "no_robot" && common.refusals.no_robot;
  const step = slow && viewport.loaded.value ? "slow" : STEPS[at]!;
  const wheels = robot?.modules.length || robot?.wheels.length || 0;
  const outline = <Outline class="silhouette" panel={robot?.panel} wheels={wheels} />;
  return (
    <div class="splash" role="group" aria-label={splash.label}>
      {robot && !link.recording ? <Portrait robot={robot.id}>{outline}</Portrait> : outline}
      {robot && (
        <strong>
          <bdi>{robot.title}</bdi>
        </strong>
      )}
      <p role="status">{refusal || splash[step]}</p>
      <progress max={STEPS.length} value={at} aria-label={splash.label} />
    </div>
  );
}
