// Types of the messages between page and dashboard server, for the type check of the page's scripts.
// Names and fields are those of from_page.py, to_page.py, fleet.py and tsd_twin/messages/status.py.

type Triple = [number, number, number];
/** Metres on the floor. */
type FloorPoint = [number, number];
type Quaternion = [number, number, number, number];

interface LeaseStatus {
  holder: string | null;
  remaining_s: number;
  requested_by: string | null;
  request_expires_in_s: number;
  reserved_for: string | null;
  reservation_expires_in_s: number;
}

/** Code of docs/codes.md with its parameters, and the reason behind it. */
interface Reason {
  code: string;
  params?: Record<string, string | number>;
  cause?: Reason | null;
}

interface Refusals {
  lease: string | null;
  no_lease: string;
  arm: string | null;
  disarm: string | null;
  reset: string | null;
  drive: string | null;
  set_pose: string | null;
  speed: string | null;
  why: Record<string, Reason>;
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
  reason: string;
  why: Reason[];
}

interface ConsistencyStatus {
  residual_mps: number;
  suspect: string | null;
  level: number;
  contributions: Record<string, number>;
}

interface WheelSpeedStatus {
  requested_rpm: number;
  spin_rpm: number;
}

interface PoseSensorStatus {
  hz: number;
  latency_s: number | null;
  used: number;
  found: number;
  dropped: Record<string, number>;
}

interface BiasStatus {
  value: number;
  sigma: number;
}

interface LoopStatus {
  hz: number;
  overruns: number;
  jitter_p99_ms: number;
  longest_ms: number;
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
  stop: Reason | null;
  arming: ArmingStatus | null;
  lease: LeaseStatus;
  refusals: Refusals | null;
  command: CommandStatus;
  limits: LimitStatus;
  consistency: ConsistencyStatus;
  wheel_speed: WheelSpeedStatus | null;
  pose_sensor: PoseSensorStatus | null;
  learned: Record<string, BiasStatus> | null;
  loop: LoopStatus;
  hardware: Hardware;
  operators: Record<string, string>;
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
  default_rpm: number;
  wheel_radius_m: number;
  servo_step_deg: number;
}

interface JointInfo {
  name: string;
  unit: string;
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
  sideways: boolean;
  panel: "gimbals" | "wheels" | "sphere" | "twist" | "joints";
  max_tilt_deg: number | null;
  modules: string[];
  wheel_speed_limits: WheelSpeedLimits | null;
  wheels: string[];
  max_rpm: number | null;
  joints: JointInfo[];
  alternative_estimate: string | null;
  not_promised: string[];
  plot_fields: string[];
}

/** Limit that scales a twist down. */
type LimitName = "speed" | "turn_rate" | "tilt" | "wheel_speed";

/** Angles in degrees, push in m/s. */
interface GimbalPose {
  alpha: number;
  beta: number;
  tilt: number;
  direction: number | null;
  axle: [number, number];
  push: [number, number];
  rpm: number;
}

interface WheelPose {
  rpm: number;
  push: [number, number];
}

interface JointPreview {
  t: "preview";
  robot: string;
  requested: Triple;
  twist: Triple;
  utilization: number;
  limit: LimitName | null;
  modules: GimbalPose[];
  wheels: WheelPose[];
  joints: JointValue[];
}

interface GimbalState {
  alpha: number;
  beta: number;
  tilt: number;
  radius_mm: number;
  rpm: number;
  alpha_setpoint: number;
  beta_setpoint: number;
  axle: [number, number];
  set_axle: [number, number];
  spinning: boolean;
  direction: number | null;
  push: [number, number];
  setpoint: GimbalPose;
}

interface WheelState {
  rpm: number;
  rpm_setpoint: number;
  residual_mps: number;
  push: [number, number];
  push_setpoint: [number, number];
}

interface JointValue {
  value: number | null;
  setpoint: number | null;
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
  why: Reason | null;
}

interface RobotState {
  t: "state";
  status_seq: number;
  robot_s: number;
  age_ms: number;
  /** Only states of a robot show that it is stopped. */
  source: "robot" | "recording" | "several";
  status: Status;
  mode_age_s: number;
  has_control: boolean;
  rtt_ms: number | null;
  rtt_jitter_ms: number | null;
  pose: Triple | null;
  twist: Triple | null;
  commanded: Triple | null;
  truth: Triple | null;
  modules: GimbalState[];
  wheels: WheelState[];
  joints: JointValue[];
  utilization: number | null;
  limit: LimitName | null;
  sphere: SphereState | null;
  estimate_difference: EstimateDifference | null;
  route: RouteState | null;
  plot: { [name: string]: number | null };
  map: MapState | null;
  past: PastState | null;
  shadow: ShadowReport | null;
}

interface PastState {
  history_offset_s: number;
  mode: string;
  pose: Triple | null;
  twist: Triple | null;
}

interface JointComparison {
  name: string;
  unit: string;
  measured: number | null;
  simulated: number;
  band: number;
  inside: boolean;
}

interface PoseComparison {
  names: [string, string, string];
  units: [string, string, string];
  difference: Triple;
  band: Triple;
  inside: boolean;
}

interface Drift {
  part: string;
  text: string;
}

interface ShadowReport {
  compared_s: number;
  joints: JointComparison[];
  pose: PoseComparison | null;
  drifts: Drift[];
  note: string;
}

interface RobotName {
  id: string;
  title: string;
  colour: string;
}

interface SessionInfo {
  t: "welcome";
  operator: string;
  name: string;
  role: string;
  user: string | null;
  may_stop: boolean;
  robots: RobotName[];
  robot: string | null;
}

interface StopResult {
  t: "stop_result";
  robot: string;
  outcome: "sent" | "acknowledged" | "not_reached";
  why: Reason | null;
}

interface FleetBattery {
  volts: number;
  low: boolean;
}

interface FleetEvent {
  kind: string;
  why: Reason;
  age_s: number;
}

interface FleetRobot {
  id: string;
  title: string;
  colour: string;
  panel: "gimbals" | "wheels" | "sphere" | "twist" | "joints";
  wheel_count: number;
  space: "floor" | "sphere";
  reach_m: number;
  source: "robot" | "recording" | "several";
  silent: boolean;
  age_s: number | null;
  mode: string | null;
  latched: boolean;
  why: Reason | null;
  driver: string | null;
  requested_by: string | null;
  operators: Record<string, string>;
  battery: FleetBattery | null;
  event: FleetEvent | null;
}

interface Fleet {
  t: "fleet";
  whole: boolean;
  robots: FleetRobot[];
  poses: Record<string, Triple>;
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

interface MapRobot {
  id: string;
  pose: Triple;
  reach_m: number;
  stale: boolean;
}

interface MapState {
  robots: MapRobot[];
  envelope: FloorPoint[] | null;
}

interface MapLines {
  t: "map_lines";
  routes: Record<string, FloorPoint[]>;
  trails: Record<string, (FloorPoint | null)[]> | null;
}

interface ViewChanged {
  t: "view";
  settings: ViewSettings;
}

interface ControlsReleased {
  t: "released";
  why: Reason;
}

interface ActionReply {
  t: "reply";
  to: string;
  ok: boolean;
  why: Reason | null;
}

interface RobotEvent {
  t: "event";
  kind: string;
  text: string;
  why: Reason;
  robot_s: number;
  past: boolean;
  age_s: number;
}

interface StudentKnob {
  key: string;
  label: string;
  unit: string;
  value: number;
  usual: number;
  least: number;
  most: number;
  step: number;
}

interface StudentFigure {
  name: string;
  value: number;
  unit: string;
  note: string;
}

interface StudentOutline {
  axes: [number, number];
  section: [number, number][];
  shadow: [number, number][];
}

interface StudentWheel {
  at: [number, number];
  push: [number, number];
  direction_deg: number | null;
  rpm: number;
  gimbal: Triple | null;
  axle: [number, number] | null;
  effective_radius_mm: number | null;
  residual_mps: number;
}

/** Part of a formula: a MathML element; absent fields are empty. */
interface MathToken {
  kind: "mi" | "mo" | "mn" | "mfrac" | "msqrt";
  text?: string;
  sub?: string;
  sup?: string;
  rows?: MathToken[][];
}

interface Equation {
  name: string;
  formula: MathToken[];
  values: (number | null)[];
  units: string[];
  over: "actuators" | "twist" | "point" | "one";
  paper: string;
  equation: string;
  corrected: boolean;
}

interface PaperCurve {
  label: string;
  x: number[];
  y: number[];
  points: boolean;
}

interface PaperFigure {
  name: string;
  paper: string;
  figure: string;
  x: string;
  x_unit: string;
  y: string;
  y_unit: string;
  curves: PaperCurve[];
}

interface StudentFigures {
  axes: TwistAxisInfo[];
  tops: Triple;
  figures: StudentFigure[];
  outlines: StudentOutline[];
  twist: Triple;
  utilization: number;
  wheels: StudentWheel[];
  radius_m: number;
  solved: "joints" | "twist";
  residual_mps: number;
  redundancy: number;
  centre: [number, number] | null;
  axis: Triple | null;
  equations: Equation[];
}

interface ShippedRobot {
  id: string;
  title: string;
}

interface StudentReply {
  t: "student";
  number: number;
  base: string;
  bases: ShippedRobot[];
  knobs: StudentKnob[];
  figures: StudentFigures | null;
  problem: string;
  toml: string | null;
  papers: PaperFigure[];
}

interface HeartbeatReply {
  t: "heartbeat";
  sent_ms: number;
}

type ServerMessage =
  | RobotInfo
  | RobotState
  | SessionInfo
  | StopResult
  | Fleet
  | PanelSliders
  | SphereClick
  | JointPreview
  | ControlsReleased
  | ActionReply
  | RobotEvent
  | StudentReply
  | MapLines
  | ViewChanged
  | HeartbeatReply
  | Timeline
  | RecordingsChanged
  | Cursor
  | PastStates;

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
  requester?: string | null;
  max_age_s?: number | null;
}

interface StudentRequest {
  number: number;
  base: string;
  knobs: Record<string, number>;
  twist: Triple;
  joints?: number[][] | null;
  toml: boolean;
  papers?: boolean;
  show?: boolean;
}

type PageMessage =
  | (StudentRequest & { t: "student" })
  | ((DriveCommand | FollowPlan) & { status_seq: number })
  | (PlanRequest & { t: "plan"; level: number })
  | (LeaseAction & { t: "lease" })
  | { t: "speed_level"; level: number }
  | { t: "preview"; twist: Triple | null }
  | { t: "heartbeat"; status_seq: number; sent_ms: number; focus: boolean }
  | { t: "wheel_speed"; cruise_speed_rpm: number }
  | { t: "robot"; id: string }
  | { t: "view"; settings: ViewSettings; look: boolean }
  | { t: "map" | "shadow" | "fleet"; on: boolean }
  | { t: "name"; name: string }
  | { t: "stop"; robot?: string | null; all?: boolean }
  | { t: "look_back"; history_offset_s: number | null }
  | { t: "plot_fields"; names: string[] }
  | { t: "clear_plan" | "release" | "panel_released" | "arm" | "disarm" | "reset" };

/** As `scene/view_settings.py` has them. */
interface ViewSettings {
  camera: "3-D" | "top" | "chase";
  follow: boolean;
  hidden: string[];
  true_pose: "when it differs" | "always" | "never";
  tilt: string;
  dark: boolean | null;
}

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

// Of a page that shows a recording: from_page.py, to_page.py.

interface TimelineEvent {
  t_s: number;
  robot: string;
  kind: string;
  text: string;
  count: number;
  why: Reason | null;
}

interface Timeline {
  t: "timeline";
  name: string;
  start_ms: number;
  duration_s: number;
  events: TimelineEvent[];
}

interface RecordingsChanged {
  t: "recordings_changed";
  revision: number;
}

interface Cursor {
  t: "cursor";
  t_s: number;
  playing: boolean;
  speed: number;
}

interface PastStates {
  t: "past";
  states: RobotState[];
}

type TimelineRequest =
  | { t: "seek"; t_s: number }
  | { t: "play"; speed: number }
  | { t: "pause" }
  | { t: "step"; back: boolean }
  | { t: "mark"; note: string };

interface RecordedPath {
  robot: string;
  colour: string;
  points: FloorPoint[];
}

/** A line of the list of recordings. */
interface RecordingName {
  name: string;
  start_ms: number;
  duration_s: number;
  robots: string[];
  marks: number;
  is_whole: boolean;
}

interface Window {
  tsd: Readonly<{
    page: string;
    hasFocus: () => boolean;
    lowDetail: boolean;
    recording: string | null;
  }>;
  /** Of the page that records, for the window of its plots. */
  tsdPlots?: { recorder: Recorder; stop: () => void; scheme: () => string };
  uPlot?: typeof import("uplot");
}

type Link = import("../static/link.js").Link;
type Drive = import("../static/drive.js").Drive;
type Notices = import("../static/notices.js").Notices;
type HandOver = import("../static/handover.js").HandOver;
type Waypoints = import("../static/waypoints.js").Waypoints;
type SliderValues = Omit<PanelSliders, "t">;
type SphereGoTo = import("../static/sphere.js").SphereGoTo;
type Recorder = import("../static/plot_recorder.js").Recorder;
type StudentModel = import("../static/student_model.js").StudentModel;

type MapView = import("../static/map_view.js").MapView;
type ViewKeeper = import("../static/view_settings.js").ViewKeeper;

/** Part of a picture, in pixels. */
interface MapBox {
  left: number;
  top: number;
  width: number;
  height: number;
}

/** What the map draws. */
interface MapContent {
  size: { width: number; height: number };
  /** Colours of what is written, and of the grid. */
  ink: string;
  line: string;
  names: RobotName[];
  robots: MapRobot[];
  shown: MapRobot | undefined;
  isStale: boolean;
  envelope: FloorPoint[] | null;
  routes: Record<string, FloorPoint[]>;
  trailOf: (id: string) => (FloorPoint | null)[];
  /** Pixels of what is being drawn. */
  stroke: [number, number][];
}

/** What explains the page. */
interface Guides {
  keySheet: import("../static/key_sheet.js").KeySheet;
  firstSteps: import("../static/first_steps.js").FirstSteps;
}

/** Figure of the readout: name, unit, and text for a state. */
type Reading = [name: string, unit: string, read: (state: Partial<RobotState>) => string];
type StickLabels = [up: string, left: string, unit: string];

/** A number that can be plotted over time. */
interface PlotField {
  /** Path in the message, with the names of wheels and axes. */
  name: string;
  /** The same, as keys and indices. */
  keys: string[];
  unit: string;
  /** Of the plot that it belongs to. */
  title: string;
  /** What its line has its colour from: the same for the set-point and the measured value. */
  part: string;
  line: "set" | "measured" | "other";
}

/** What is seen of the plots, for their charts. */
interface PlotView {
  span(): [number, number];
  splits(fromS: number, toS: number, stepS: number): number[];
  timeText(atS: number): string;
  onCursor(at: number | null): void;
}

/** What follows a pointer on a control; `gone` comes when it has left by itself. */
interface PointerCallbacks {
  came: (event: PointerEvent) => void;
  moved?: (event: PointerEvent) => void;
  gone: (event: PointerEvent) => void;
}

/** Setting of the Student tab: a shipped robot, its changed knobs, and a twist. */
interface StudentSetting {
  base: string;
  knobs: Record<string, number>;
  twist: Triple;
}

/** A module of a singularity drive, as it is drawn large. */
interface ModuleView {
  tilt_deg: number;
  /** Lean of the axle along the axes of the robot; length 1 is the tilt limit. */
  lean: [number, number];
  rpm: number;
  radius_mm: number;
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
  /** Names of the fields that are plotted at first. */
  plots: (robot: RobotInfo) => string[];
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
