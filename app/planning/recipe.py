"""A caller's choices as one value: how to plan, whatever the problem."""

from dataclasses import dataclass, replace
from typing import Generic, TypeVar, cast

from app.planning.methods.base import LearnedProposal, Method, MethodOptions, Named
from app.planning.methods.sampler import Samplers
from app.planning.methods.settling import able, settled
from app.planning.objectives import TERMINAL_ERROR, Objective
from app.planning.problem import Cost
from app.planning.refining.refinement import Refinement
from app.planning.uncertainty.uncertainty import Uncertainty

Choice_co = TypeVar("Choice_co", bound=Named, covariant=True)

Other = TypeVar("Other", bound=Named)


@dataclass(frozen=True, slots=True)
class Recipe(Generic[Choice_co]):
    """How to plan. With `MethodOptions` it is known what it costs; with a `Method` it can be
    followed."""

    method: Choice_co
    """Proposes the candidates."""
    num_candidates: int
    """K."""
    refinement: Refinement | None = None
    """Descend from the candidates through the true dynamics before they are ranked; None ranks
    them as they were proposed (the paper)."""
    objective: Objective = TERMINAL_ERROR
    """What ranks candidates that arrive equally well."""
    reachability: bool = False
    """Whether the plan also says how near any plan could come, which takes about 0.7 ms."""
    outline: bool = False
    """Whether the plan comes with the outline of the reachable set, which takes about 2 ms."""
    uncertainty: Uncertainty | None = None
    """Plants that may be the true one: their errors rank the candidates, and refinement is for all
    of them. None plans for the plant of the problem alone."""

    def settled(self, samplers: Samplers | None) -> "Recipe[MethodOptions]":
        """Return the same with nothing left open; arguments and errors as for the method's."""
        return self._with(settled(self.method, samplers))

    def able(self: "Recipe[MethodOptions]", proposal: LearnedProposal | None) -> "Recipe[Method]":
        """Return the same with a method that can propose; arguments as for the method's."""
        return self._with(able(self.method, proposal))

    def cost(self: "Recipe[MethodOptions]") -> Cost:
        """Return what a plan takes: proposing, a rollout of each candidate, and refinement.

        Without refinement it is exactly that. With it the rollouts are an estimate for a plan that
        does not arrive (`Refinement.cost`), and what was spent stands in the plan's own cost.
        """
        cost = self.method.cost(self.num_candidates) + Cost(rollouts=self.num_candidates)
        if self.refinement:
            cost += self.refinement.cost(self.num_candidates, self.objective)
        if self.uncertainty:
            refined = self.refinement is not None
            cost += self.uncertainty.cost(self.num_candidates, refined=refined)
        return cost

    @property
    def unrefined(self) -> "Recipe[Choice_co]":
        """The same without refinement."""
        return replace(self, refinement=None)

    def _with(self, method: Other) -> "Recipe[Other]":
        same: Recipe[Named] = self
        return cast(Recipe[Other], replace(same, method=method))
