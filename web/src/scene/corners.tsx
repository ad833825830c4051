// Controls on the view: modes of driving, cameras, the legend of the scene, and a way back to the robot.

import { useComputed } from "@preact/signals";
import { isOnFloor } from "../drive/axes";
import { isOver, type Path } from "../drive/path";
import { type Layer, type RobotInfo, TILT_FACTORS } from "../generated/wire";
import { useSession } from "../session";
import { freshness, isCurrent } from "../store/freshness";
import { whyNotPlan } from "../store/permission";
import { refusalText, words } from "../text/reasons";
import { figure, texts } from "../text/text";
import { Button } from "../ui/button";
import { Icon } from "../ui/icon";
import { Segmented } from "../ui/segmented";
import { PicturePane } from "./picture_pane";

/** Choice of stick, goal or line, for robots on a floor that can be driven. */
export function Modes() {
  const { link, path } = useSession();
  const { modes, path: labels } = texts().scene;
  const { label, ...choices } = modes;
  if (freshness(link).kind === "recorded" || !isOnFloor(link.robot.value)) return null;
  const refusal = whyNotPlan(link);
  const refused = refusal && refusalText(refusal);
  const isShown = path.offered.value || path.route.value !== null;
  return (
    <div class="corner tl">
      <div data-covers>
        <Segmented
          label={label}
          value={path.mode.value}
          choices={choices}
          refused={{ to: refused, draw: refused }}
          onChoose={(mode) => (mode === "stick" ? path.clear() : path.choose(mode))}
        />
      </div>
      <div class={isShown ? "chip path-status" : "sr"}>
        <span
          role="status"
          aria-label={labels.label}
          tabIndex={isShown ? 0 : undefined}
          aria-live={path.route.value?.phase === "going" ? "off" : "polite"}
        >
          {pathText(path) || null}
        </span>
        {isShown && <Button icon="close" label={labels.clear} onPress={() => path.clear()} />}
      </div>
    </div>
  );
}

/** Length, progress or end of the path, or what to do for one. */
function pathText({ route: { value: route }, mode: { value: mode } }: Path): string {
  const { path: labels } = texts().scene;
  if (route === null || (isOver(route) && mode !== "stick"))
    return mode === "stick" ? "" : labels[mode];
  const length = figure(route.length_m, 2);
  switch (route.phase) {
    case "planning":
      return labels.planning;
    case "planned":
      return labels.planned(length, figure(route.time_s, 1));
    case "going":
      return labels.going(figure(route.done_m, 2), length);
    case "arrived":
      return labels.arrived(figure(route.off_mm));
    case "ended":
      return labels.ended(route.why ? words(route.why) : "");
  }
}

export function Cameras() {
  const { view, pictures } = useSession();
  const { cameras, home, pictures: words } = texts().scene;
  const { label, ...presets } = cameras;
  const choices = { ...presets, ...(pictures.camera.value && { picture: words.label }) };
  return (
    <div class="corner tr" data-covers>
      <Segmented
        label={label}
        value={pictures.main.value ? "picture" : view.settings.value.camera}
        choices={choices}
        onChoose={(camera) => {
          pictures.main.value = camera === "picture";
          if (camera === "picture") pictures.open.value = true;
          else view.set({ camera }, true);
        }}
      />
      <div class="seg">
        <Button icon="home" label={home} onPress={() => view.set({}, true)} />
      </div>
    </div>
  );
}

/** Colours that are in the scene of this robot now, and how much its tilt is exaggerated. */
export function Legend() {
  const { link, view, path } = useSession();
  const { scene } = texts();
  const robot = link.robot.value;
  const { hidden, true_pose, tilt } = view.settings.value;
  if (robot === null) return null;
  const isShown = (layer: Layer) => !hidden.includes(layer);
  const hasPath = path.route.value !== null && isShown("planned_path");
  const rows = legend(robot, isShown, hasPath, true_pose === "always");
  const reached = link.state.value?.stop_reaches;
  const title = link.welcome.value?.robots.find(({ id }) => id === reached)?.title;
  const next = TILT_FACTORS[(TILT_FACTORS.indexOf(tilt) + 1) % TILT_FACTORS.length];
  return (
    <div class="corner br">
      <div class="legend-row" data-covers>
        {reached && (
          <b class="chip stop-reaches" role="alert">
            {scene.stopReaches(title ?? reached)}
          </b>
        )}
        {rows.length > 0 && (
          <ul class="chip legend" aria-label={scene.legend}>
            {rows.map(({ sign, name }) => (
              <li key={name}>
                <i class={`sw ${sign}`} />
                {scene[name]}
              </li>
            ))}
          </ul>
        )}
        {robot.panel === "gimbals" && (
          <button type="button" class="chip" onClick={() => view.set({ tilt: next })}>
            {scene.tilt} <b>{scene.times(tilt.slice(1))}</b>
          </button>
        )}
      </div>
      <PicturePane />
    </div>
  );
}

/** Signs of the scene with their meanings, less the hidden layers. */
export function legend(
  robot: RobotInfo,
  isShown: (layer: Layer) => boolean,
  hasPath: boolean,
  hasTruth: boolean,
) {
  const onFloor = isOnFloor(robot);
  const pushes = robot.modules.length + robot.wheels.length > 0;
  const rows = [
    { sign: "arrow", name: "push", shown: pushes && isShown("thrust") },
    { sign: "line", name: "axle", shown: robot.modules.length > 0 },
    { sign: "line", name: "trail", shown: onFloor && isShown("trail") },
    { sign: "truth", name: "truth", shown: hasTruth && isShown("true_pose") },
    { sign: "plan", name: "planned", shown: hasPath },
    { sign: "dash", name: "stopsWithin", shown: onFloor && isShown("stop_envelope") },
  ] as const;
  return rows.filter(({ shown }) => shown);
}

const ACROSS = 42; // Half axes of the ellipse on which it moves, in percent.
const DOWN = 36;

/** Arrow at the rim of the picture towards a robot outside it; a click brings the robot back. */
export function RimArrow() {
  const { link, view } = useSession();
  const directionRad = useComputed(() => link.state.value?.camera?.off_screen_rad ?? null).value;
  if (directionRad === null || !isCurrent(freshness(link))) return null;
  const left = 50 + ACROSS * Math.cos(directionRad);
  const top = 50 - DOWN * Math.sin(directionRad);
  return (
    <button
      type="button"
      class="chip rim-arrow"
      aria-label={texts().scene.home}
      title={texts().scene.home}
      style={{ left: `${left.toFixed(1)}%`, top: `${top.toFixed(1)}%` }}
      onClick={() => view.set({}, true)}
    >
      <Icon name="ahead" style={{ rotate: `${-directionRad}rad` }} />
    </button>
  );
}
