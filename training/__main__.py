"""`python -m training`: train a model and publish it in a model store."""

import logging
import os
import sys
import tomllib
from pathlib import Path

import click
import matplotlib
import torch
from pydantic import ValidationError
from tqdm.contrib.logging import logging_redirect_tqdm

from training.config import DEFAULT_CONFIG, TrainingConfig
from training.export import export, version_directory
from training.trainer import Trainer, TrainingInterrupted

INTERRUPTED = 130

log = logging.getLogger("training")


@click.command(context_settings={"show_default": True})
@click.option(
    "--config",
    type=click.Path(dir_okay=False, path_type=Path),
    default=DEFAULT_CONFIG,
    help="TOML file with a name, and what differs from the default configuration.",
)
@click.option(
    "--model-store",
    type=click.Path(file_okay=False, path_type=Path),
    default="model_store",
    help="Where the finished model is published.",
)
@click.option(
    "--run-directory",
    type=click.Path(file_okay=False, path_type=Path),
    help="Where the run keeps its state.  [default: .training/NAME-VERSION]",
)
def main(config: Path, model_store: Path, run_directory: Path | None) -> None:
    """Train a model and publish it; started again, an interrupted run goes on where it was."""
    try:
        settings = TrainingConfig.read(config)
        version_directory(model_store, settings)
        directory = run_directory or Path(".training") / f"{settings.name}-{settings.version}"
        log_file = _log_to(directory)
    except (OSError, tomllib.TOMLDecodeError, ValidationError) as error:
        sys.exit(f"cannot train: {error}")
    matplotlib.use("Agg")
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    threads = torch.get_num_threads()
    log.info("%s version %d on %s", settings.name, settings.version, device)
    log.info("torch %s, %d threads, %d cores", torch.__version__, threads, os.cpu_count() or 1)
    with logging_redirect_tqdm():
        try:
            trainer = Trainer(settings, directory, device)
            trainer.run()
        except TrainingInterrupted as interruption:
            log.info("%s; the same command goes on from there", interruption)
            sys.exit(INTERRUPTED)
        except (ValueError, FloatingPointError, OSError) as error:
            sys.exit(f"cannot train: {error}")
    log.info("done")
    print(export(trainer, model_store, log_file))


def _log_to(run_directory: Path) -> Path:
    """Send the log to the terminal and to the run's own file; return the file."""
    run_directory.mkdir(parents=True, exist_ok=True)
    path = run_directory / "training.log"
    logging.basicConfig(
        level=logging.INFO,
        format="%(asctime)s %(message)s",
        datefmt="%Y-%m-%d %H:%M:%S",
        handlers=[logging.StreamHandler(), logging.FileHandler(path)],
    )
    return path


if __name__ == "__main__":
    main()
