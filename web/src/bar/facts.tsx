// Mode, grade of the link and battery: what holds now, never what did.

import { useSession } from "../session";
import { freshness, isCurrent } from "../store/freshness";
import { quality } from "../store/quality";
import { figure, texts } from "../text/text";
import { Button } from "../ui/button";
import { Figure } from "../ui/figure";
import { Icon, MODE_ICONS } from "../ui/icon";

export function Mode() {
  const { link } = useSession();
  const { bar, common } = texts();
  const fresh = freshness(link);
  const isLive = fresh.kind === "live";
  const kind = isLive ? (link.state.value?.status.mode ?? "") : fresh.kind;
  const unknown = { starting: bar.connecting, no_robot: bar.noRobot }[kind] ?? bar.noSignal;
  const text = isLive ? (common.modes[kind] ?? kind) : unknown;
  return (
    <span class={`mode ${kind}`} role="status" aria-label={common.mode}>
      <Icon name={MODE_ICONS[kind] ?? "ring"} />
      {fresh.kind === "recorded" ? bar.recordings[fresh.by] : text}
    </span>
  );
}

/** Grade of the link with the figure behind it; it opens Health, which has the rest. */
export function LinkFact() {
  const { link, layout } = useSession();
  const { bar } = texts();
  const { kind } = freshness(link);
  if (kind === "recorded" || kind === "starting" || kind === "no_robot") return null;
  const { grade, bad, figure: of } = quality(link);
  const isKnown = kind !== "live" || of !== null;
  const unit = of?.unit === "%" ? bar.lost : grade === "uneven" ? bar.jitter : "ms";
  const warns = bad && isKnown;
  return (
    <Button
      class={warns ? "fact link warn" : "fact link"}
      icon={warns ? "warn" : "link"}
      onPress={() => layout.open("health")}
    >
      <span class="sr">{bar.link}: </span>
      <b>{isKnown ? bar.grades[grade] : figure(null)}</b>{" "}
      <span>{of && <Figure value={of.value} unit={unit} />}</span>
      <span class="sr">. {bar.openHealth}</span>
    </Button>
  );
}

/** Voltage of robots that measure it; they say themselves when it is low. */
export function Battery() {
  const { link } = useSession();
  const { bar } = texts();
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

/** Address of this page with another hash; a bare hash would be relative to the base address. */
export function withHash(hash: string): string {
  return `${location.pathname}${location.search}#${hash}`;
}

export function FleetLink({ onClick }: { onClick?: () => void }) {
  const { fleet } = texts().bar;
  return (
    <a class="btn fleet-link" href={withHash("fleet")} aria-label={fleet} onClick={onClick}>
      <Icon name="grid" />
      <span>{fleet}</span>
    </a>
  );
}
