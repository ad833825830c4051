// View tab: what the scene shows on this page, and the colours and language of the page.

import type { ComponentChild } from "preact";
import { type Layer, LAYERS, TILT_FACTORS, type TiltFactor } from "../generated/wire";
import { useSession } from "../session";
import { type Language, language, texts } from "../text/text";
import { Segmented } from "../ui/segmented";

const THEMES = { system: null, light: false, dark: true };

export function ThemeChoice() {
  const { view } = useSession();
  const { theme: label, themes: words } = texts().panel.view;
  const all = Object.keys(THEMES) as (keyof typeof THEMES)[];
  const theme = all.find((one) => THEMES[one] === view.settings.value.dark) ?? "system";
  const choose = (one: typeof theme) => view.set({ dark: THEMES[one] });
  return <Segmented label={label} value={theme} choices={words} onChoose={choose} />;
}

export function LanguageChoice() {
  const { language: label, languages: words } = texts().panel.view;
  const choose = (one: Language) => (language.value = one);
  return <Segmented label={label} value={language.value} choices={words} onChoose={choose} />;
}

export function ViewTab() {
  const { view, link, pictures } = useSession();
  const { view: words } = texts().panel;
  const settings = view.settings.value;
  const { hidden } = settings;
  const tilts = Object.fromEntries(
    TILT_FACTORS.map((factor) => [factor, words.times(factor.slice(1))]),
  ) as Record<TiltFactor, string>;
  const layers = LAYERS.filter(
    (layer) =>
      layer !== "true_pose" && // It has more than two choices, below.
      (layer !== "other_estimate" || link.robot.value?.alternative_estimate),
  );
  const show = (layer: Layer, on: boolean) => {
    const others = hidden.filter((other) => other !== layer);
    view.set({ hidden: on ? others : [...others, layer] });
  };
  return (
    <>
      <section class="sec">
        <h2>{words.scene}</h2>
        {choice(words.tilt, settings.tilt, tilts, (tilt) => view.set({ tilt }))}
        {tick(words.follow, settings.follow, (follow) => view.set({ follow }))}
        {choice(words.sharpness, view.sharpness.value, words.sharpnesses, (sharpness) => {
          view.sharpness.value = sharpness;
        })}
      </section>
      <section class="sec">
        <h2>{words.layers}</h2>
        <div class="ticks">
          {layers.map((layer) =>
            tick(words.layer[layer], !hidden.includes(layer), (on) => show(layer, on)),
          )}
          {pictures.seen.value.some(({ robot }) => robot === null) &&
            tick(words.floorCamera, settings.floor_camera, (floor_camera) =>
              view.set({ floor_camera }),
            )}
        </div>
        {choice(words.truePose, settings.true_pose, words.truePoses, (true_pose) =>
          view.set({ true_pose, hidden: hidden.filter((layer) => layer !== "true_pose") }),
        )}
      </section>
      <section class="sec">
        <h2>{words.page}</h2>
        {labelled(words.theme, <ThemeChoice />)}
        {labelled(words.language, <LanguageChoice />)}
      </section>
    </>
  );
}

/** Choice of one of the values with a text in `words`, in that order. */
function choice<T extends string>(
  label: string,
  value: T,
  words: Record<T, string>,
  onChoose: (value: T) => void,
) {
  const all = <Segmented label={label} value={value} choices={words} onChoose={onChoose} />;
  return labelled(label, all);
}

function labelled(label: string, choices: ComponentChild) {
  return (
    <div class="choice">
      <span aria-hidden="true">{label}</span>
      {choices}
    </div>
  );
}

function tick(label: string, on: boolean, onTick: (on: boolean) => void) {
  return (
    <label class="tick" key={label}>
      <input
        type="checkbox"
        checked={on}
        aria-description={texts().panel.view.enterTicks}
        onChange={(event) => onTick(event.currentTarget.checked)}
      />
      {label}
    </label>
  );
}
