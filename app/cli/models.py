"""`breakaway models`: what is in the model store."""

import click

from app.failure import Failure
from app.settings_options import read_settings


@click.command()
@click.option("--machines", is_flag=True, help="List the machines that have a name, instead.")
def models(machines: bool) -> None:
    """List the models of the store.

    Each is checked against its manifest. The store is the one that is shipped, or
    BREAKAWAY_MODEL_STORE.
    """
    if machines:
        from app.cli.machines_table import print_machines

        print_machines()
        return
    from rich.box import SIMPLE
    from rich.console import Console
    from rich.table import Column, Table

    from app.inference.verification import ModelRejected, find_skipped, find_versions, verify
    from app.planning.plant.plant_range import in_words

    store = read_settings(["model_store"]).model_store
    try:
        directories = find_versions(store)
    except ModelRejected as error:
        raise Failure(str(error)) from None
    table = Table(
        Column("model", no_wrap=True), "f_s", "f_c", "b", "u_max", "H", "loss", "sha256", box=SIMPLE
    )
    rejected = []
    for directory in directories:
        try:
            manifest, _ = verify(directory)
        except ModelRejected as error:
            rejected.append(str(error))
            continue
        plants = manifest.plants
        table.add_row(
            f"{manifest.name}/{manifest.version}",
            in_words(plants.static_friction),
            in_words(plants.coulomb_friction),
            in_words(plants.viscous_damping),
            in_words(plants.control_limit),
            str(manifest.horizon),
            f"{manifest.losses.validation:.4f}",
            manifest.sha256[:12],
        )
    Console().print(table)
    for line in find_skipped(store):
        click.echo(f"skipped: {line}", err=True)
    if rejected:
        raise Failure("\n".join(rejected))
