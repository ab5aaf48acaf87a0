"""`python -m app` is the `breakaway` command."""

from app.cli import breakaway

breakaway(prog_name="breakaway")
