// Corners of the view: how to drive, the cameras, and what the colours of the scene mean.

import { isOnFloor } from "../drive/axes";
import type { PathMode } from "../drive/path";
import { CAMERA_PRESETS, type Layer, type RobotInfo, TILT_FACTORS } from "../generated/wire";
import { useSession } from "../session";
import { freshness } from "../store/freshness";
import { whyNotPlan } from "../store/permission";
import { figure } from "../text/numbers";
import { refusalText, words } from "../text/reasons";
import { texts } from "../text/text";
import { Button } from "../ui/button";
import { Segmented } from "../ui/segmented";

/** Choice of stick, goal or line, for robots on a floor that can be driven. */
export function Modes() {
  const { link, path } = useSession();
  const { modes } = texts().scene;
  const hidden = freshness(link).kind === "recorded" || !isOnFloor(link.robot.value);
  if (hidden) return null;
  const refusal = whyNotPlan(link);
  const refused = refusal && refusalText(refusal);
  const choices = (["stick", "to", "draw"] as const).map((value) => ({
    value,
    text: modes[value],
    refused: value === "stick" ? null : refused,
  }));
  const choose = (mode: PathMode) => (mode === "stick" ? path.clear() : path.choose(mode));
  return (
    <div class="corner tl">
      <div data-covers>
        <Segmented
          label={modes.label}
          value={path.mode.value}
          choices={choices}
          onChoose={choose}
        />
      </div>
      <PathStatus />
    </div>
  );
}

/** Length, progress or end of the path, or what to do for one. */
function PathStatus() {
  const { path } = useSession();
  const { path: labels } = texts().scene;
  const text = usePathText();
  const shown = path.offered.value || path.route.value !== null;
  return (
    <div class={shown ? "chip path-status" : "sr"}>
      <span
        role="status"
        aria-label={labels.label}
        aria-live={path.route.value?.phase === "going" ? "off" : "polite"}
      >
        {text}
      </span>
      {shown && <Button icon="close" label={labels.clear} onPress={() => path.clear()} />}
    </div>
  );
}

/** Text of the path, also for the place of the next step. */
export function usePathText(): string {
  const { path } = useSession();
  const { path: labels } = texts().scene;
  const route = path.route.value;
  const mode = path.mode.value;
  const isOld = route?.phase === "arrived" || route?.phase === "ended";
  if (route === null || (isOld && mode !== "stick")) return mode === "stick" ? "" : labels[mode];
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
  const { view } = useSession();
  const { cameras, home } = texts().scene;
  return (
    <div class="corner tr" data-covers>
      <Segmented
        label={cameras.label}
        value={view.settings.value.camera}
        choices={CAMERA_PRESETS.map((value) => ({ value, text: cameras[value] }))}
        onChoose={(camera) => view.set({ camera }, true)}
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
  if (robot === null) return null;
  const isShown = (layer: Layer) => !view.settings.value.hidden.includes(layer);
  const hasPath = path.route.value !== null && isShown("planned_path");
  const rows = legend(robot, isShown, hasPath, view.settings.value.true_pose === "always");
  return (
    <div class="corner br" data-covers>
      {rows.length > 0 && (
        <ul class="chip legend" aria-label={scene.legend}>
          {rows.map(({ sign, names }) => (
            <li key={sign}>
              <i class={`sw ${sign}`} />
              {names.map((name) => scene[name]).join(", ")}
            </li>
          ))}
        </ul>
      )}
      {robot.panel === "gimbals" && <Tilt />}
    </div>
  );
}

type Name = "push" | "axle" | "trail" | "truth" | "stopsWithin" | "planned";

/** Signs of the scene with their meanings, less the hidden layers. */
export function legend(
  robot: RobotInfo,
  isShown: (layer: Layer) => boolean,
  hasPath: boolean,
  hasTruth: boolean,
): { sign: string; names: Name[] }[] {
  const onFloor = isOnFloor(robot);
  const pushes = robot.modules.length + robot.wheels.length > 0 && isShown("thrust");
  const lines: Name[] = robot.modules.length > 0 ? ["axle"] : [];
  if (onFloor && isShown("trail")) lines.push("trail");
  const rows: { sign: string; names: Name[]; shown: boolean }[] = [
    { sign: "arrow", names: ["push"], shown: pushes },
    { sign: "line", names: lines, shown: lines.length > 0 },
    { sign: "truth", names: ["truth"], shown: hasTruth && isShown("true_pose") },
    { sign: "plan", names: ["planned"], shown: hasPath },
    { sign: "dash", names: ["stopsWithin"], shown: onFloor && isShown("stop_envelope") },
  ];
  return rows.filter(({ shown }) => shown).map(({ sign, names }) => ({ sign, names }));
}

/** Factor by which the picture exaggerates the tilt; a press takes the next one. */
function Tilt() {
  const { view } = useSession();
  const { scene } = texts();
  const { tilt } = view.settings.value;
  const next = TILT_FACTORS[(TILT_FACTORS.indexOf(tilt) + 1) % TILT_FACTORS.length];
  return (
    <button type="button" class="chip" onClick={() => view.set({ tilt: next })}>
      {scene.tilt} <b>{scene.times(tilt.slice(1))}</b>
    </button>
  );
}
