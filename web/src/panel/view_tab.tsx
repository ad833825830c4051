// View tab: what the scene shows on this page, and the colours and language of the page.

import { LAYERS, TILT_FACTORS, TRUE_POSE_DISPLAYS } from "../generated/wire";
import { useSession } from "../session";
import { SHARPNESS } from "../store/view";
import { type Language, language, LANGUAGES, texts } from "../text/text";
import { Segmented } from "../ui/segmented";

const THEMES = { system: null, light: false, dark: true };

export function ViewTab() {
  const { view, link } = useSession();
  const { view: words } = texts().panel;
  const settings = view.settings.value;
  const { hidden } = settings;
  const layers = LAYERS.filter(
    (layer) =>
      layer !== "true_pose" && // It has more than two choices, below.
      (layer !== "other_estimate" || link.robot.value?.alternative_estimate),
  );
  const theme = (["system", "light", "dark"] as const).find((one) => THEMES[one] === settings.dark);
  return (
    <>
      <section class="sec">
        <h2>{words.scene}</h2>
        <Choice
          label={words.tilt}
          value={settings.tilt}
          choices={TILT_FACTORS.map((value) => [value, words.times(value.slice(1))])}
          onChoose={(tilt) => view.set({ tilt })}
        />
        <Tick label={words.follow} on={settings.follow} onTick={(follow) => view.set({ follow })} />
        <Choice
          label={words.sharpness}
          value={view.sharpness.value}
          choices={SHARPNESS.map((value) => [value, words.sharpnesses[value]])}
          onChoose={(value) => (view.sharpness.value = value)}
        />
      </section>
      <section class="sec">
        <h2>{words.layers}</h2>
        <div class="ticks">
          {layers.map((layer) => (
            <Tick
              key={layer}
              label={words.layer[layer]}
              on={!hidden.includes(layer)}
              onTick={(on) =>
                view.set({
                  hidden: on ? hidden.filter((other) => other !== layer) : [...hidden, layer],
                })
              }
            />
          ))}
        </div>
        <Choice
          label={words.truePose}
          value={settings.true_pose}
          choices={TRUE_POSE_DISPLAYS.map((value) => [value, words.truePoses[value]])}
          onChoose={(true_pose) =>
            view.set({ true_pose, hidden: hidden.filter((layer) => layer !== "true_pose") })
          }
        />
      </section>
      <section class="sec">
        <h2>{words.page}</h2>
        <Choice
          label={words.theme}
          value={theme ?? "system"}
          choices={(["system", "light", "dark"] as const).map((one) => [one, words.themes[one]])}
          onChoose={(one) => view.set({ dark: THEMES[one] })}
        />
        <Choice<Language>
          label={words.language}
          value={language.value}
          choices={LANGUAGES.map((one) => [one, words.languages[one]])}
          onChoose={(one) => (language.value = one)}
        />
      </section>
    </>
  );
}

interface ChoiceProps<T extends string> {
  label: string;
  value: T;
  choices: readonly (readonly [T, string])[];
  onChoose: (value: T) => void;
}

function Choice<T extends string>({ label, value, choices, onChoose }: ChoiceProps<T>) {
  return (
    <div class="choice">
      <span aria-hidden="true">{label}</span>
      <Segmented
        label={label}
        value={value}
        choices={choices.map(([one, text]) => ({ value: one, text }))}
        onChoose={onChoose}
      />
    </div>
  );
}

interface TickProps {
  label: string;
  on: boolean;
  onTick: (on: boolean) => void;
}

function Tick({ label, on, onTick }: TickProps) {
  return (
    <label class="tick">
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
