"""How figures draw each entrant."""

from app.evaluation import entrants
from app.figures.style import BLUE, GREEN, GREY, ORANGE, PINK, RED, SKY, Look

LOOKS = {
    entrants.PAPER_DIFFUSION: Look(BLUE, "o", "-"),
    entrants.DIFFUSION: Look(SKY, "s", "-"),
    entrants.REFINED_DIFFUSION: Look(SKY, "D", ":"),
    entrants.DATASET_PRIOR: Look(ORANGE, "^", "-"),
    entrants.REFINED_PRIOR: Look(ORANGE, "v", ":"),
    entrants.UNIFORM: Look(GREY, "x", "--"),
    entrants.CEM: Look(RED, "P", "-"),
    entrants.ICEM: Look(PINK, "X", "--"),
    entrants.MPPI: Look(GREEN, "*", "--"),
}
