"""Who takes part: the paper's methods, ours, and their refined plans."""

from app.evaluation.question import Entrant
from app.figures.style import BLUE, GREEN, GREY, ORANGE, PINK, RED, SKY, Look

PAPER_MODEL = "dry-friction-fs0.7"
"""The model of the paper's plant, trained as the paper says."""
ANY_MODEL = "any-machine"
"""The model of every machine."""
PAPER_DIFFUSION = Entrant(
    "Action Diffusion (paper)",
    {"method": {"name": "action_diffusion", "sampler": "paper"}, "model": PAPER_MODEL},
    Look(BLUE, "o", "-"),
)
"""With the paper's sampler, DDIM, 50 steps, guidance scale 2, and its model of the plant."""
DIFFUSION = Entrant("Action Diffusion", {"method": "action_diffusion"}, Look(SKY, "s", "-"))
"""With the model and the sampler that the service chooses."""
DATASET_PRIOR = Entrant("Dataset Prior", {"method": "dataset_prior"}, Look(ORANGE, "^", "-"))
UNIFORM = Entrant("Uniform", {"method": "uniform"}, Look(GREY, "x", "--"))
CEM = Entrant("CEM (40 it.)", {"method": "cem"}, Look(RED, "P", "-"))
ICEM = Entrant("iCEM (40 it.)", {"method": "icem"}, Look(PINK, "X", "--"))
MPPI = Entrant("MPPI (40 it.)", {"method": "mppi"}, Look(GREEN, "*", "--"))
REFINED_DIFFUSION = Entrant(
    "Action Diffusion, refined", DIFFUSION.fields | {"refine": True}, Look(SKY, "D", ":")
)
REFINED_PRIOR = Entrant(
    "Dataset Prior, refined", DATASET_PRIOR.fields | {"refine": True}, Look(ORANGE, "v", ":")
)

PAPER_ENTRANTS = (PAPER_DIFFUSION, DATASET_PRIOR, CEM)
"""The rows of the paper's tables."""
ENTRANTS = (*PAPER_ENTRANTS, UNIFORM, DIFFUSION, ICEM, MPPI, REFINED_DIFFUSION, REFINED_PRIOR)
