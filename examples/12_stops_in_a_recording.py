"""Print when and why the robots in a recording stopped, and their last command."""

import sys

import tsd_twin


def main() -> None:
    recording = tsd_twin.open_recording(sys.argv[1])
    told = "nothing"
    for message in recording.messages():
        if message.topic.endswith("/twist"):
            speed = message.value.twist.linear
            told = f"({speed.x:.2f}, {speed.y:.2f}) m/s {message.topic.split('/')[3]}"
        elif message.topic.endswith("/event/mode") and " to stop" in message.value["text"]:
            print(f"{message.t_s:6.2f} s  {message.value['text']}  Told before: {told}.")


if __name__ == "__main__":
    main()
