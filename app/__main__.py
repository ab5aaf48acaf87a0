"""`python -m app` is the `breakaway` command."""

from app.cli import app

app(prog_name="breakaway")
