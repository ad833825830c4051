"""`python -m research`: studies that are not of the papers, each with a figure and a table."""

from __future__ import annotations

from research import alarms, budget, camera_gap, consistency, go_to, mismatch, prediction, thesis
from tsd_twin.cli import program
from tsd_twin.cli.experiment import Experiment
from tsd_twin.cli.experiments import run_experiments

EXPERIMENTS: tuple[Experiment, ...] = (
    mismatch.EXPERIMENT,
    go_to.EXPERIMENT,
    budget.EXPERIMENT,
    consistency.EXPERIMENT,
    alarms.EXPERIMENT,
    camera_gap.EXPERIMENT,
    prediction.EXPERIMENT,
    thesis.EXPERIMENT,
)
"""All studies; add a row for a new one."""


if __name__ == "__main__":
    parser = program.parser(
        "python -m research",
        "Studies in virtual time: each prints figures and writes PNG and CSV files to a folder.",
        ["python -m research budget --runs 2000   effect of each error on the open-loop square"],
    )
    run_experiments(parser, EXPERIMENTS)
