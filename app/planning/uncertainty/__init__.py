"""Plans for plants that are not known: ensembles, risks, robust plans and what they are worth."""
