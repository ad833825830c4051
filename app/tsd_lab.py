"""`tsd-lab`: experiments and calibration, each with a figure and a table."""

from __future__ import annotations

from tsd_twin.cli import program

with program.requires("tsd-lab", "lab"):
    from tsd_twin.calibration import calibrate, turning, zeroing
    from tsd_twin.cli.experiment import Experiment, Output
    from tsd_twin.cli.experiments import run_experiments
    from tsd_twin.lab import health, motors, papers, remote, rerun, square, tracking


EXPERIMENTS: tuple[Experiment, ...] = (
    motors.EXPERIMENT,
    square.EXPERIMENT,
    tracking.EXPERIMENT,
    health.EXPERIMENT,
    calibrate.EXPERIMENT,
    zeroing.EXPERIMENT,
    turning.EXPERIMENT,
    papers.OMNI_STEP,
    tracking.OMNI_PATHS,
    papers.ATLAS,
    rerun.EXPERIMENT,
    remote.EXPERIMENT,
)
"""Experiments of `tsd-lab`, one module each."""

__all__ = ["EXPERIMENTS", "Experiment", "Output"]


PARSER = program.parser(
    "tsd-lab",
    "Experiments in virtual time: each prints figures, and leaves PNG and CSV in a folder.",
    [
        "tsd-lab motors                          Table 1 of the thesis to its Table 2",
        "tsd-lab square --loop camera            its 1 m square, closed loop",
        "tsd-lab follow --path eight --out run1  a path, timed to the limits",
        "tsd-lab atlas                           Fig. 7 of the paper on the spherical platform",
        "tsd-lab square --help                   flags and examples of one experiment",
    ],
)


def main() -> None:
    """Read the flags and run."""
    run_experiments(PARSER, EXPERIMENTS)


if __name__ == "__main__":
    main()
