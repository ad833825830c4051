"""Commissioning of a real robot, `tsd-bridge --check`: steps, their verdicts, and the sheet."""
