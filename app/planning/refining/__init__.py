"""From candidates to plans that arrive, through the true dynamics."""
