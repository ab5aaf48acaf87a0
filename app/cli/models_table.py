"""What `breakaway models` prints of the models of a store."""

from collections.abc import Sequence

from rich.box import SIMPLE
from rich.console import Console
from rich.table import Column, Table

from app.inference.manifest import Manifest
from app.planning.methods.sampler import SamplerSettings


def print_models(manifests: Sequence[Manifest]) -> None:
    """Print a line for each model, and below them what each covers and was trained on."""
    console = Console(highlight=False, markup=False)
    table = Table(
        Column("model", no_wrap=True),
        Column("H", justify="right"),
        "kind",
        "predicts",
        Column("loss", justify="right"),
        "sha256",
        box=SIMPLE,
    )
    for manifest in manifests:
        table.add_row(
            manifest.label,
            str(manifest.horizon),
            manifest.kind,
            manifest.predicts,
            f"{manifest.losses.validation:.4f}",
            manifest.sha256[:8],
        )
    console.print(table)
    for manifest in manifests:
        console.print(f"{manifest.label}: plants with {manifest.coverage}.")
        console.print(f"Trained on: {manifest.trained_on}")
        if manifest.uncertainty:
            shares = (f"{name} by {share:.0%}" for name, share in manifest.uncertainty.items())
            console.print(f"Knows plants that may be off: {', '.join(shares)}.")
        samplers = manifest.samplers
        defaults = (_sampler("dpm_solver", samplers.dpm_solver), _sampler("ddim", samplers.ddim))
        console.print(f"By default: {', '.join(defaults)}.\n")


def _sampler(name: str, settings: SamplerSettings) -> str:
    return f"{name} with {settings.steps} steps, s = {settings.guidance_scale:g}"
