"""`breakaway models`: what is in the model store."""

import click

from app.failure import Failure
from app.settings_options import read_settings


@click.command()
@click.option("--machines", is_flag=True, help="List the machines that have a name, instead.")
def models(machines: bool) -> None:
    """List the models of the store, and what they cover.

    Each is checked against its manifest. The store is the one that is shipped, or
    BREAKAWAY_MODEL_STORE.
    """
    if machines:
        from app.cli.machines_table import print_machines

        print_machines()
        return
    from app.cli.models_table import print_models
    from app.inference.verification import ModelRejected, find_skipped, find_versions, verify

    store = read_settings(["model_store"]).model_store
    try:
        directories = find_versions(store)
    except ModelRejected as error:
        raise Failure(str(error)) from None
    manifests, rejected = [], []
    for directory in directories:
        try:
            manifest, _ = verify(directory)
        except ModelRejected as error:
            rejected.append(str(error))
        else:
            manifests.append(manifest)
    print_models(manifests)
    for line in find_skipped(store):
        click.echo(f"skipped: {line}", err=True)
    if rejected:
        raise Failure("\n".join(rejected))
