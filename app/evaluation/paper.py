"""What the paper prints: mean ± standard deviation."""

from typing import NamedTuple

from app.evaluation.entrants import CEM, DATASET_PRIOR, PAPER_DIFFUSION


class MultistepRow(NamedTuple):
    """A row of Table 2."""

    final_error: str
    mean_end_error: str
    stuck_steps: str
    time: str
    """Seconds for a sequence of three plans, on the paper's machine."""


MULTISTEP = {
    (PAPER_DIFFUSION, 16): MultistepRow("0.20 ± 0.3", "0.17 ± 0.1", "23.2 ± 18.7", "0.68 ± 0.1"),
    (DATASET_PRIOR, 16): MultistepRow("0.38 ± 0.4", "0.40 ± 0.2", "69.9 ± 19.3", "0.07 ± 0.0"),
    (CEM, 16): MultistepRow("0.43 ± 0.3", "0.49 ± 0.2", "105.6 ± 11.3", "2.54 ± 0.2"),
    (PAPER_DIFFUSION, 32): MultistepRow("0.19 ± 0.3", "0.16 ± 0.1", "18.8 ± 18.1", "0.75 ± 0.1"),
    (DATASET_PRIOR, 32): MultistepRow("0.34 ± 0.4", "0.37 ± 0.2", "60.7 ± 17.6", "0.08 ± 0.0"),
    (CEM, 32): MultistepRow("0.36 ± 0.3", "0.40 ± 0.2", "63.0 ± 9.3", "2.57 ± 0.3"),
    (PAPER_DIFFUSION, 128): MultistepRow("0.18 ± 0.3", "0.15 ± 0.1", "17.1 ± 14.9", "0.76 ± 0.1"),
    (DATASET_PRIOR, 128): MultistepRow("0.32 ± 0.4", "0.31 ± 0.2", "46.5 ± 16.6", "0.11 ± 0.0"),
    (CEM, 128): MultistepRow("0.31 ± 0.4", "0.25 ± 0.2", "27.9 ± 16.9", "2.56 ± 0.1"),
    (PAPER_DIFFUSION, 512): MultistepRow("0.17 ± 0.3", "0.13 ± 0.1", "15.9 ± 17.0", "1.56 ± 0.6"),
    (DATASET_PRIOR, 512): MultistepRow("0.29 ± 0.4", "0.25 ± 0.2", "33.6 ± 15.7", "0.33 ± 0.2"),
    (CEM, 512): MultistepRow("0.19 ± 0.3", "0.14 ± 0.1", "22.2 ± 16.7", "3.47 ± 1.2"),
}
"""Table 2."""

MEAN_END_ERROR_BY_FRICTION = {
    PAPER_DIFFUSION: {0.6: "0.14 ± 0.1", 0.7: "0.15 ± 0.1", 0.8: "0.10 ± 0.1"},
    DATASET_PRIOR: {0.6: "0.30 ± 0.2", 0.7: "0.31 ± 0.2", 0.8: "0.31 ± 0.2"},
    CEM: {0.6: "0.22 ± 0.2", 0.7: "0.25 ± 0.2", 0.8: "0.22 ± 0.2"},
}
"""Table 3, by f_s."""
