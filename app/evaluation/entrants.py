"""Who takes part: the paper's methods, ours, and their refined plans."""

from app.evaluation.question import Entrant

PAPER_DIFFUSION = Entrant(
    "Action Diffusion (paper)", {"method": {"name": "action_diffusion", "sampler": "paper"}}
)
"""With the paper's sampler: DDIM, 50 steps, guidance scale 2."""
DIFFUSION = Entrant("Action Diffusion", {"method": "action_diffusion"})
"""With the default sampler, six network evaluations."""
DATASET_PRIOR = Entrant("Dataset Prior", {"method": "dataset_prior"})
UNIFORM = Entrant("Uniform", {"method": "uniform"})
CEM = Entrant("CEM (40 it.)", {"method": "cem"})
ICEM = Entrant("iCEM (40 it.)", {"method": "icem"})
MPPI = Entrant("MPPI (40 it.)", {"method": "mppi"})
REFINED_DIFFUSION = Entrant(
    "Action Diffusion, refined", {"method": "action_diffusion", "refine": True}
)
REFINED_PRIOR = Entrant("Dataset Prior, refined", {"method": "dataset_prior", "refine": True})

PAPER_ENTRANTS = (PAPER_DIFFUSION, DATASET_PRIOR, CEM)
"""The rows of the paper's tables."""
ENTRANTS = (
    *PAPER_ENTRANTS,
    UNIFORM,
    DIFFUSION,
    ICEM,
    MPPI,
    REFINED_DIFFUSION,
    REFINED_PRIOR,
)
