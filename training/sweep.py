"""`python -m training.sweep`: several trainings, one after the other or on a Ray cluster."""

import subprocess
import sys
from concurrent.futures import Executor, ThreadPoolExecutor
from pathlib import Path

import click


@click.command(context_settings={"show_default": True})
@click.argument(
    "configs", nargs=-1, required=True, type=click.Path(exists=True, dir_okay=False, path_type=Path)
)
@click.option(
    "--model-store",
    type=click.Path(file_okay=False, path_type=Path),
    default="model_store",
    help="Where the finished models are published; on a cluster, a folder that all machines share.",
)
@click.option("--ray", "on_ray", is_flag=True, help="Train on the cluster, as many as it has room.")
@click.option("--cores", type=click.IntRange(min=1), default=1, help="Of each training on Ray.")
def main(configs: tuple[Path, ...], model_store: Path, on_ray: bool, cores: int) -> None:
    """Train a model by each of CONFIGS, each as `python -m training` does; all share a store."""
    with _executor(on_ray, cores) as executor:
        runs = {
            config: executor.submit(train, config.resolve(), model_store.resolve())
            for config in configs
        }
        failed = [str(config) for config, run in runs.items() if run.result()]
    if failed:
        sys.exit(f"not trained: {', '.join(failed)}")


def train(config: Path, model_store: Path) -> int:
    """Train by a configuration in a process of its own; return its exit status."""
    options = ("--config", str(config), "--model-store", str(model_store))
    runs = model_store / ".runs" / config.stem
    command = [sys.executable, "-m", "training", *options, "--run-directory", str(runs)]
    return subprocess.run(command, check=False).returncode


def _executor(on_ray: bool, cores: int) -> Executor:
    if not on_ray:
        return ThreadPoolExecutor(1)
    from training.on_ray import RayExecutor

    return RayExecutor(cores)


if __name__ == "__main__":
    main()
