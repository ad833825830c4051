// Sheet of keys and settings; in a narrow window it also has what the bar has no room for.

import { useSession } from "../session";
import { LANGUAGES, language, texts } from "../text/text";
import { Button } from "../ui/button";
import { Dialog } from "../ui/dialog";
import { Segmented } from "../ui/segmented";
import { OwnName } from "./account";
import type { Opened } from "./bar";
import { Actions, Who } from "./driver";
import { FleetLink, padName } from "./facts";

const LANGUAGE_NAMES = { en: "English", de: "Deutsch" } as const;
const THEMES = ["system", "dark", "light"] as const;

export function Sheet({ opened }: { opened: Opened }) {
  const { layout } = useSession();
  const { bar } = texts();
  const close = () => (opened.value = null);
  return (
    <Dialog title={bar.help} onClose={close}>
      {layout.phone.value && layout.screen.value === "robot" && (
        <div class="row">
          <Who />
          <Actions opened={opened} />
          <FleetLink class="btn edge" onClick={close} />
        </div>
      )}
      <Keys list={bar.keyList} />
      <div class="row">
        <Button edge onPress={() => (opened.value = "name")}>
          <OwnName />
        </Button>
        <Settings />
      </div>
    </Dialog>
  );
}

export function GamepadDialog({ onClose }: { onClose: () => void }) {
  const { gamepad } = useSession();
  return (
    <Dialog title={padName(gamepad.name.value ?? "")} onClose={onClose}>
      <Keys list={texts().bar.padKeys} />
    </Dialog>
  );
}

/** List of lines "key: what it does". */
function Keys({ list }: { list: readonly string[] }) {
  return (
    <dl class="keys">
      {list.map((line) => {
        const [keys = "", what] = line.split(": ");
        return [
          <dt key={keys}>
            <kbd>{keys}</kbd>
          </dt>,
          <dd key={what}>{what}</dd>,
        ];
      })}
    </dl>
  );
}

function Settings() {
  const { view } = useSession();
  const { bar } = texts();
  const { dark } = view.settings.value;
  return (
    <>
      <Segmented
        label={bar.theme}
        value={dark === null ? "system" : dark ? "dark" : "light"}
        choices={THEMES.map((value) => ({ value, text: bar.themes[value] }))}
        onChoose={(theme) => view.set({ dark: theme === "system" ? null : theme === "dark" })}
      />
      <Segmented
        label={bar.language}
        value={language.value}
        choices={LANGUAGES.map((value) => ({ value, text: LANGUAGE_NAMES[value] }))}
        onChoose={(chosen) => (language.value = chosen)}
      />
    </>
  );
}
