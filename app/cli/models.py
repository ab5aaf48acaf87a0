"""`breakaway models`: what is in the model store."""

import click

from app.failure import Failure
from app.settings_options import read_settings


@click.command()
def models() -> None:
    """List the models of the store.

    Each is checked against its manifest. The store is the one that is shipped, or
    BREAKAWAY_MODEL_STORE.
    """
    from rich.box import SIMPLE
    from rich.console import Console
    from rich.table import Column, Table

    from app.inference.verification import ModelRejected, find_versions, verify

    try:
        directories = find_versions(read_settings().model_store)
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
        system = manifest.system
        table.add_row(
            f"{manifest.name}/{manifest.version}",
            f"{system.static_friction:g}",
            f"{system.coulomb_friction:g}",
            f"{system.viscous_damping:g}",
            f"{system.control_limit:g}",
            str(manifest.horizon),
            f"{manifest.losses.validation:.4f}",
            manifest.sha256[:12],
        )
    Console().print(table)
    if rejected:
        raise Failure("\n".join(rejected))
