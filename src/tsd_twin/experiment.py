"""Old name of `tsd_twin.cli.experiment`, kept for one release."""

from __future__ import annotations

from tsd_twin.cli.experiment import (
    CAMERA_COLOUR as CAMERA_COLOUR,
)
from tsd_twin.cli.experiment import (
    ESTIMATE_COLOUR as ESTIMATE_COLOUR,
)
from tsd_twin.cli.experiment import (
    PERCENT_STEPS as PERCENT_STEPS,
)
from tsd_twin.cli.experiment import (
    REFERENCE_COLOUR as REFERENCE_COLOUR,
)
from tsd_twin.cli.experiment import (
    SERIES_COLOURS as SERIES_COLOURS,
)
from tsd_twin.cli.experiment import (
    TRUTH_COLOUR as TRUTH_COLOUR,
)
from tsd_twin.cli.experiment import (
    Axes as Axes,
)
from tsd_twin.cli.experiment import (
    CaseT as CaseT,
)
from tsd_twin.cli.experiment import (
    Experiment as Experiment,
)
from tsd_twin.cli.experiment import (
    Output as Output,
)
from tsd_twin.cli.experiment import (
    T as T,
)
from tsd_twin.cli.experiment import (
    add_jobs_flag as add_jobs_flag,
)
from tsd_twin.cli.experiment import (
    add_legend as add_legend,
)
from tsd_twin.cli.experiment import (
    in_percent_steps as in_percent_steps,
)
from tsd_twin.cli.experiment import (
    label_axes as label_axes,
)
from tsd_twin.cli.experiment import (
    markdown_table as markdown_table,
)
from tsd_twin.cli.experiment import (
    new_figure as new_figure,
)
from tsd_twin.cli.experiment import (
    run_cases as run_cases,
)
from tsd_twin.cli.experiment import (
    spread as spread,
)
