"""Experiments and calibration, in virtual time or on a robot: each leaves a picture and a table."""

from tsd_twin.lab import (
    atlas,
    budget,
    calibrate,
    follow,
    motors,
    omni_paths,
    omni_step,
    square,
    zero,
)
from tsd_twin.lab.experiment import Experiment
from tsd_twin.lab.output import Output

EXPERIMENTS: tuple[Experiment, ...] = (
    motors.EXPERIMENT,
    square.EXPERIMENT,
    follow.EXPERIMENT,
    budget.EXPERIMENT,
    calibrate.EXPERIMENT,
    zero.EXPERIMENT,
    omni_step.EXPERIMENT,
    omni_paths.EXPERIMENT,
    atlas.EXPERIMENT,
)
"""What `tsd-lab` can do; one more is one more file and one more row."""

__all__ = ["EXPERIMENTS", "Experiment", "Output"]
