// Types of the messages between page and dashboard server, for the type check of the page's scripts.
// Names and fields are those of protocol.py and of tsd_twin/messages/status.py.

type Triple = [number, number, number];
type Quaternion = [number, number, number, number];

interface LeaseStatus {
  holder: string | null;
  remaining_s: number;
  asked_by: string | null;
  asks_for_s: number;
  reserved_for: string | null;
  reserved_s: number;
}

interface Refusals {
  lease: string | null;
  without_lease: string;
  arm: string | null;
  disarm: string | null;
  reset: string | null;
  drive: string | null;
  set_pose: string | null;
  speed: string | null;
}

interface CommandStatus {
  seq: number;
  age_s: number | null;
  echo_s: number | null;
  accepted: number;
  dropped: Record<string, number>;
}

interface LimitStatus {
  speed_mps: number;
  turn_rate_rad_per_s: number;
  max_command_age_s: number;
  stop_allowance_m: number;
  applied: number;
}

interface ConsistencyStatus {
  residual_mps: number;
  suspect: string | null;
  level: number;
  explained: Record<string, number>;
}

interface WheelSpeedStatus {
  wanted_rpm: number;
  spin_rpm: number;
}

interface PoseSensorStatus {
  hz: number;
  late_s: number | null;
  used: number;
  found: number;
  dropped: Record<string, number>;
}

interface LoopStatus {
  hz: number;
  overruns: number;
  jitter_p99_ms: number;
}

interface ArmingStatus {
  phase: string;
  progress: number;
}

type Hardware = { [name: string]: unknown };

interface Status {
  mode: string;
  stop_reason: string;
  stops: number;
  arming: ArmingStatus | null;
  lease: LeaseStatus;
  refusals: Refusals | null;
  command: CommandStatus;
  limits: LimitStatus;
  consistency: ConsistencyStatus;
  wheel_speed: WheelSpeedStatus | null;
  pose_sensor: PoseSensorStatus | null;
  loop: LoopStatus;
  hardware: Hardware;
}

// From the server.

interface SpeedLimits {
  speed_mps: number;
  turn_rate_rad_per_s: number;
}

interface TwistAxisInfo {
  name: string;
  symbol: string;
  unit: string;
}

interface WheelSpeedLimits {
  least_rpm: number;
  most_rpm: number;
  usual_rpm: number;
  wheel_radius_m: number;
  servo_step_deg: number;
}

interface RobotInfo {
  t: "robot";
  id: string;
  title: string;
  limits: SpeedLimits;
  levels: number[];
  space: "floor" | "sphere";
  twist_axes: TwistAxisInfo[];
  twist_scale_m: number;
  panel: "gimbals" | "wheels" | "sphere";
  max_tilt_deg: number | null;
  modules: string[];
  wheel_speed_limits: WheelSpeedLimits | null;
  wheels: string[];
  max_rpm: number | null;
  alternative_estimate: string | null;
}

interface GimbalState {
  alpha: number;
  beta: number;
  tilt: number;
  radius_mm: number;
  rpm: number;
  set_alpha: number;
  set_beta: number;
  axle: [number, number];
  set_axle: [number, number];
  spinning: boolean;
}

interface WheelState {
  rpm: number;
  set_rpm: number;
  residual_mps: number;
}

interface SphereState {
  wxyz: Quaternion;
  ideal: Triple;
  dual: Triple | null;
  angle_deg: number | null;
  magnitude_percent: number | null;
  rows: number[];
}

interface EstimateDifference {
  metres: number;
  degrees: number;
}

interface RouteState {
  number: number;
  phase: "planning" | "planned" | "going" | "arrived" | "ended";
  length_m: number;
  time_s: number;
  done_m: number;
  off_mm: number;
  reason: string;
}

interface RobotState {
  t: "state";
  seen: number;
  age_ms: number;
  status: Status;
  mode_age_s: number;
  you: boolean;
  robot_ms: number | null;
  robot_jitter_ms: number | null;
  pose: Triple | null;
  twist: Triple | null;
  commanded: Triple | null;
  truth: Triple | null;
  modules: GimbalState[];
  wheels: WheelState[];
  sphere: SphereState | null;
  estimate_difference: EstimateDifference | null;
  route: RouteState | null;
}

interface RobotName {
  id: string;
  title: string;
  colour: string;
}

interface SessionInfo {
  t: "welcome";
  operator: string;
  role: string;
  user: string | null;
  may_stop: boolean;
  robots: RobotName[];
  robot: string | null;
}

interface PanelSliders {
  t: "panel_sliders";
  vx: number;
  vy: number;
  omega: number;
  mode: "preview" | "drive";
  latch: boolean;
}

interface SphereClick {
  t: "sphere_click";
  robot: string;
  at: Triple;
}

interface ControlsReleased {
  t: "released";
  reason: string;
}

interface ActionReply {
  t: "reply";
  to: string;
  ok: boolean;
  reason: string;
}

interface RobotEvent {
  t: "event";
  kind: string;
  text: string;
  robot_s: number;
  past: boolean;
  age_s: number;
}

interface HeartbeatReply {
  t: "heartbeat";
  sent_ms: number;
}

type ServerMessage =
  | RobotInfo
  | RobotState
  | SessionInfo
  | PanelSliders
  | SphereClick
  | ControlsReleased
  | ActionReply
  | RobotEvent
  | HeartbeatReply;

/** The messages by their `t`, and the three events of the link itself. */
type LinkEvents = { [M in Exclude<ServerMessage, HeartbeatReply> as M["t"]]: M } & {
  up: undefined;
  down: undefined;
  beat: undefined;
};

// From the page.

interface DriveCommand {
  t: "drive";
  vx: number;
  vy: number;
  omega: number;
  frame: "base_link" | "odom";
}

interface FollowPlan {
  t: "follow_plan";
  route: number | null;
}

interface PlanRequest {
  kind: "to" | "draw";
  points: [number, number][];
  on: "floor" | "picture";
  heading?: number | null;
}

interface LeaseAction {
  op: "acquire" | "release" | "request" | "withdraw" | "grant" | "deny";
  take_over?: boolean;
  reason?: string;
  asker?: string | null;
  max_age_s?: number | null;
}

type PageMessage =
  | ((DriveCommand | FollowPlan) & { seen: number })
  | (PlanRequest & { t: "plan"; level: number })
  | (LeaseAction & { t: "lease" })
  | { t: "speed_level"; level: number }
  | { t: "heartbeat"; seen: number; sent_ms: number; focus: boolean }
  | { t: "wheel_speed"; cruise_speed_rpm: number }
  | { t: "robot"; id: string }
  | { t: "clear_plan" | "release" | "panel_released" | "arm" | "disarm" | "reset" | "stop" };

// Within the page.

/** Shares of what the speed level allows. */
interface Unit {
  x: number;
  y: number;
  turn: number;
}

/** A control, as `drive.js` describes it. */
interface MotionSource {
  readonly held: boolean;
  cancel(): void;
  readonly unit?: Unit;
  readonly twist?: { vx: number; vy: number; omega: number };
  readonly command?: FollowPlan;
}

interface Window {
  tsd: Readonly<{ page: string; hasFocus: () => boolean; plain: boolean }>;
}

type Link = import("../static/link.js").Link;
type Drive = import("../static/drive.js").Drive;
type Notices = import("../static/notices.js").Notices;
type HandOver = import("../static/handover.js").HandOver;
type Waypoints = import("../static/waypoints.js").Waypoints;
type SliderValues = Omit<PanelSliders, "t">;
type SphereGoTo = import("../static/sphere.js").SphereGoTo;
type Recorder = import("../static/plots.js").Recorder;

/** Figure of the readout: name, unit, and text for a state. */
type Reading = [name: string, unit: string, read: (state: Partial<RobotState>) => string];
type StickLabels = [up: string, left: string, unit: string];

/** A plot over time, and its legend. */
interface PlotRow {
  title: string;
  unit: string;
  decimals: number;
  /** Least end of the value axis. */
  least: number;
  series: [label: string, channel: string][];
  /** Whether each channel has a commanded one, and a sign. */
  commanded?: boolean;
}

/** A line of a plot; it has the colour of its swatch. */
interface PlotLine {
  channel: string;
  width: number;
  swatch: Element;
}

/** From a time or value to pixels. */
type PixelScale = (value: number) => number;

interface PlotFrame {
  x: PixelScale;
  y: PixelScale;
  top: number;
  bottom: number;
  width: number;
  nowS: number;
}

/** What follows a pointer on a control; `gone` comes when it has left by itself. */
interface PointerCallbacks {
  came: (event: PointerEvent) => void;
  moved?: (event: PointerEvent) => void;
  gone: (event: PointerEvent) => void;
}

/** A hint for the first visit: shown at `target` when it makes sense, until it has been followed. */
interface Hint {
  readonly target: Element;
  readonly text: string;
  when: (state: RobotState) => boolean;
  done: (state: RobotState) => boolean;
}

/** What the page has for robots of a kind. */
interface Kind {
  /** Whether it drives on a floor: paths and axes of the world make sense. */
  onFloor: boolean;
  /** Between the components of a twist and the controls: stick up, stick left, turn left. */
  controls: {
    twist: (x: number, y: number, turn: number) => Triple;
    unit: (twist: Triple) => Unit;
    labels: StickLabels;
    help: string;
  };
  /** Groups of the readout. */
  readings: Record<string, Reading[]>;
  arm: string;
  disarm: string;
  armHint: string;
  /** Content of the actuator tab. */
  Panel: new (link: Link, place: HTMLElement, signal: AbortSignal, goTo: SphereGoTo) => object;
  plots: (robot: RobotInfo) => PlotRow[];
}

type Listeners = {
  [K in keyof HTMLElementEventMap as `on${K}`]?: (event: HTMLElementEventMap[K]) => unknown;
};

/** Attributes of an element; those with the name `on…` are listeners. */
interface Attributes extends Listeners {
  [name: string]: string | number | boolean | null | undefined | ((event: never) => unknown);
}

/** What an element is made of. */
type Content = Node | string | null | Attributes;
