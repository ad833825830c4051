import type { PageCode } from "../../store/permission";

/** Words that several areas use. */
export const common = {
  title: (robot: string) => `${robot} · tsd-twin`,
  fleet: "All robots · tsd-twin",
  mode: "Mode",
  modes: {
    disarmed: "Disarmed",
    arming: "Arming",
    ready: "Ready",
    driving: "Driving",
    stopping: "Stopping",
    stopped: "Stopped",
    fault: "Fault",
  } as Record<string, string>,
  refusals: {
    connecting: "Connecting to the robot.",
    not_connected: "No connection to the dashboard.",
    no_robot: "No robot is on the bus.",
    robot_silent: "The robot is silent.",
    recording_shown: "This is a recording: it cannot be driven.",
    replay_shown: "This is a replay of a recording: it cannot be driven.",
    viewer_only: "You may look, not drive.",
    viewer_cannot_stop: "You may look, not stop.",
    still_moves: "The robot still moves: release the other controls.",
    no_path: "There is no path: click on the floor first.",
  } satisfies Record<PageCode, string> as Record<PageCode, string>,
  cancel: "Cancel",
  close: "Close",
  search: "Search",
  noAnswer: "No answer",
};
