import type { Texts } from "../text";

export const common: Texts["common"] = {
  title: (robot) => `${robot} · tsd-twin`,
  fleet: "Alle Roboter · tsd-twin",
  mode: "Zustand",
  modes: {
    disarmed: "Aus",
    arming: "Startet",
    ready: "Bereit",
    driving: "Fährt",
    stopping: "Bremst",
    stopped: "Gestoppt",
    fault: "Störung",
  },
  refusals: {
    connecting: "Verbindet sich mit dem Roboter.",
    not_connected: "Keine Verbindung zum Dashboard.",
    no_robot: "Kein Roboter am Bus.",
    robot_silent: "Der Roboter schweigt.",
    recording_shown: "Das ist eine Aufzeichnung: Sie lässt sich nicht fahren.",
    replay_shown: "Hier läuft eine Aufzeichnung: Sie lässt sich nicht fahren.",
    viewer_only: "Sie dürfen zusehen, nicht fahren.",
    viewer_cannot_stop: "Sie dürfen zusehen, nicht stoppen.",
    still_moves: "Der Roboter bewegt sich noch: Lassen Sie die anderen Bedienelemente los.",
    no_path: "Es gibt keinen Weg: Klicken Sie zuerst auf den Boden.",
  },
  cancel: "Abbrechen",
  close: "Schließen",
  search: "Suchen",
  noAnswer: "Keine Antwort",
};
