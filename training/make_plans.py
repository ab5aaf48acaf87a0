"""`python -m training.make_plans`: make the plans of a training beforehand, in several processes.

A training makes the plans that it lacks, in threads beside it: this is for plans that take long.
"""

import os
import sys
import tomllib
from pathlib import Path

import click
from pydantic import ValidationError

from training.config import PlansConfig, TrainingConfig
from training.plan_store import PlanStore
from training.streams import Stream


@click.command(context_settings={"show_default": True})
@click.option(
    "--config",
    type=click.Path(dir_okay=False, path_type=Path),
    required=True,
    help="TOML file of the training.",
)
@click.option(
    "--parent",
    type=click.Path(file_okay=False, path_type=Path),
    default=".training",
    help="Folder of the run directory.",
)
@click.option(
    "--processes", type=click.IntRange(min=1), default=os.cpu_count(), help="Side by side."
)
def main(config: Path, parent: Path, processes: int) -> None:
    """Make what is missing of the plans of a training; stopped and started again, it goes on."""
    try:
        settings = TrainingConfig.read(config)
    except (OSError, tomllib.TOMLDecodeError, ValidationError) as error:
        sys.exit(f"cannot make plans: {error}")
    data = settings.data
    if not isinstance(data, PlansConfig):
        sys.exit("cannot make plans: this training needs none")
    store = PlanStore(settings, data, parent)
    store.make(Stream.VALIDATION_DATA, [0], data.validation_samples, processes)
    last = data.chunks_in_pool + (settings.optimisation.steps - 1) // data.steps_per_chunk
    store.make(Stream.TRAINING_DATA, range(last), data.plans_at_once, processes)


if __name__ == "__main__":
    main()
