"""From a log of a machine to its plant, how sure that is, and an ensemble of plants."""
