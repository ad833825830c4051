// Mode, gamepad, grade of the link and battery: what holds now, never what did.

import { useSession } from "../session";
import { freshness, isCurrent } from "../store/freshness";
import type { Link } from "../store/link";
import { quality } from "../store/quality";
import { figure } from "../text/numbers";
import { texts } from "../text/text";
import { Button } from "../ui/button";
import { Figure } from "../ui/figure";
import { Icon, type IconName } from "../ui/icon";

const ICONS: Record<string, IconName> = {
  disarmed: "ring",
  arming: "half",
  ready: "full",
  driving: "play",
  stopping: "pause",
  stopped: "stopsign",
  fault: "warn",
};

export function Mode() {
  const { kind, icon, text } = shownMode(useSession().link);
  return (
    <span class={`mode ${kind}`} role="status" aria-label={texts().common.mode}>
      <Icon name={icon} />
      {text}
    </span>
  );
}

/** Return the mode, or what stands in its place while it is not known. */
function shownMode(link: Link): { kind: string; icon: IconName; text: string } {
  const { bar, common } = texts();
  void link.beat.value; // A robot falls silent without a message.
  const fresh = freshness(link);
  const mode = link.state.value?.status.mode ?? "";
  if (fresh.kind === "live")
    return { kind: mode, icon: ICONS[mode] ?? "ring", text: common.modes[mode] ?? mode };
  if (fresh.kind === "recorded")
    return { kind: "past", icon: "previous", text: bar.recordings[fresh.by] };
  if (fresh.kind === "starting") return { kind: "none", icon: "half", text: bar.connecting };
  if (fresh.kind === "no_robot") return { kind: "none", icon: "ring", text: bar.noRobot };
  return { kind: "none", icon: "warn", text: bar.noSignal };
}

export function GamepadFact({ onPress }: { onPress: () => void }) {
  const { gamepad, link } = useSession();
  const name = gamepad.name.value;
  if (name === null || link.recording !== null) return null;
  return (
    <Button class="fact pad" icon="gamepad" onPress={onPress}>
      <span class="sr">{texts().bar.gamepad}: </span>
      <bdi>{padName(name)}</bdi>
    </Button>
  );
}

/** Return the name of a gamepad without the ids that browsers put around it. */
export function padName(id: string): string {
  const bare = id.replace(/^[0-9a-f]{4}-[0-9a-f]{4}-/i, "").replace(/\s*\(.*$/, "");
  return bare.trim() || texts().bar.gamepad;
}

/** Grade of the link with the figure behind it; it opens Health, which has the rest. */
export function LinkFact() {
  const { link, layout } = useSession();
  const { bar } = texts();
  void link.beat.value;
  const { kind } = freshness(link);
  if (kind === "recorded" || kind === "starting" || kind === "no_robot") return null;
  const { grade, bad, figure: of } = quality(link);
  const isKnown = kind !== "live" || of !== null;
  const unit = of?.unit === "%" ? bar.lost : grade === "uneven" ? bar.jitter : "ms";
  const warns = bad && isKnown;
  const classes = warns ? "fact link warn" : "fact link";
  return (
    <Button class={classes} icon={warns ? "warn" : "link"} onPress={() => layout.open("health")}>
      <span class="sr">{bar.link}: </span>
      <b>{isKnown ? bar.grades[grade] : figure(null)}</b>
      <span>{of && <Figure value={of.value} unit={unit} />}</span>
      <span class="sr">. {bar.openHealth}</span>
    </Button>
  );
}

/** Voltage of robots that measure it; they say themselves when it is low. */
export function Battery() {
  const { link } = useSession();
  const { bar } = texts();
  void link.beat.value;
  const status = link.state.value?.status;
  const volts = status?.hardware["battery_v"];
  if (status === undefined || typeof volts !== "number") return null;
  const current = isCurrent(freshness(link));
  const low = current && status.limits.why.some(({ code }) => code === "battery_low");
  return (
    <span class={low ? "fact battery warn" : "fact battery"}>
      <Icon name={low ? "warn" : "battery"} />
      <span class="sr">{bar.battery}: </span>
      {low && bar.batteryLow}
      <span>
        <b>{figure(current ? volts : null, 1)}</b>
        <span class="u">V</span>
      </span>
    </span>
  );
}

/** Address of this page with another hash; by itself, a hash is relative to the base address. */
export function withHash(hash: string): string {
  return `${location.pathname}${location.search}#${hash}`;
}

export function FleetLink(props: { class: string; onClick?: () => void }) {
  const { fleet } = texts().bar;
  return (
    <a href={withHash("fleet")} aria-label={fleet} {...props}>
      <Icon name="grid" />
      <span>{fleet}</span>
    </a>
  );
}
