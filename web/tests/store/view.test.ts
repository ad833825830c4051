import { beforeEach, expect, test } from "vitest";
import { fakeBrowser, openPage } from "../support/page";

beforeEach(fakeBrowser);

const kept = (view: unknown) => localStorage.setItem("tsd-view", JSON.stringify(view));

test("the settings that a browser has kept are sent with each connection, as they are then", () => {
  kept({
    camera: "chase",
    follow: true,
    hidden: ["trail"],
    true_pose: "never",
    tilt: "x10",
    dark: false,
  });
  const { session, socket, say, welcome } = openPage();
  const sent = () => socket.take("view").map(({ settings }) => settings);
  say(welcome);
  session.view.set({ follow: false });
  say(welcome);
  const settings = { camera: "chase", hidden: ["trail"], true_pose: "never", tilt: "x10" };
  expect(sent()).toMatchObject([
    { ...settings, follow: true },
    { ...settings, follow: false },
    { ...settings, follow: false },
  ]);
});

test("of settings that another version has kept, those that are unknown have usual values", () => {
  kept({
    camera: "chase",
    hidden: ["trail", "of an older version"],
    tilt: 7,
    floor_camera: 1,
    dark: "very",
  });
  const { session } = openPage();
  expect(session.view.settings.value).toEqual({
    camera: "chase",
    follow: true,
    hidden: ["trail"],
    true_pose: "when_different",
    tilt: "x5",
    floor_camera: false,
    dark: null,
  });
  for (const damaged of [null, 7, [], "top", { camera: "above", hidden: 3 }]) {
    kept(damaged);
    const { settings } = openPage().session.view;
    expect([settings.value.camera, settings.value.hidden]).toEqual(["3-D", []]);
  }
});
