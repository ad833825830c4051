// Sphere: its marks from above, the angular velocity by both contact models, and turns that bring a
// mark to the top.

import { onScreen } from "../drive/axes";
import { turned } from "../drive/sphere";
import type { SphereState } from "../generated/wire";
import { useSession } from "../session";
import { whyNotDrive } from "../store/permission";
import { refusalText } from "../text/reasons";
import { figure, texts } from "../text/text";
import { Button } from "../ui/button";
import { REACH, Ring } from "./dial";
import { quantity, Table } from "./table";

const MARKS = [
  ["front", [1, 0, 0]],
  ["back", [-1, 0, 0]],
  ["left", [0, 1, 0]],
  ["right", [0, -1, 0]],
  ["top", [0, 0, 1]],
  ["bottom", [0, 0, -1]],
] as const;

export function Sphere({ sphere }: { sphere: SphereState | null }) {
  const { link, sphere: turn } = useSession();
  const { sphere: words } = texts().panel;
  const refusal = whyNotDrive(link);
  return (
    <section class="sec">
      <h2>{words.title}</h2>
      <div class="globe">
        <Ring label={words.picture}>{sphere && <Marks wxyz={sphere.wxyz} />}</Ring>
        <Table
          label={words.models}
          heads={["rad/s", words.ideal, words.dual]}
          rows={["ωx", "ωy", "ωz"].map((name, i) =>
            quantity(name, "", 2, sphere?.ideal[i], sphere?.dual?.[i]),
          )}
        />
      </div>
      {typeof sphere?.angle_deg === "number" && (
        <p>{words.between(figure(sphere.angle_deg, 2), figure(sphere.magnitude_percent, 2))}</p>
      )}
      {sphere?.rows.some((row) => row > 0) && (
        <p>{words.rows(sphere.rows.map((row) => words.row[row] ?? "–").join(", "))}</p>
      )}
      <p>{words.bringHint}</p>
      <div class="bring" role="group" aria-label={words.bring}>
        {MARKS.map(([name, at]) => (
          <Button
            key={name}
            edge
            refused={refusal && refusalText(refusal)}
            onPress={() => turn.bring(at)}
          >
            {words.marks[name]}
          </Button>
        ))}
      </div>
    </section>
  );
}

function Marks({ wxyz }: Pick<SphereState, "wxyz">) {
  return (
    <>
      {MARKS.map(([name, at]) => {
        const [x, y, z] = turned(wxyz, at);
        const { right, down } = onScreen({ x: REACH * x, y: REACH * y });
        const below = z < 0 ? "below" : "";
        return <circle key={name} class={`mark ${name} ${below}`} r="5" cx={right} cy={down} />;
      })}
    </>
  );
}
