"""`breakaway plan`: one plan in this process, without a server."""

from collections.abc import Mapping
from contextlib import ExitStack, closing
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import click

from app.cli.files import STANDARD_OUTPUT, check_writable, write_text
from app.cli.request_options import json_option, picture_option, request_options
from app.failure import Failure
from app.settings_options import read_settings

if TYPE_CHECKING:
    from app.inference.engine import Engine
    from app.inference.model_store import ModelStore
    from app.settings import Settings
    from app.wire.answers import MultistepPlanResponse, PlanResponse
    from app.wire.requests import MultistepPlanRequest, PlanRequest


@click.command()
@request_options(
    file="JSON as for POST /plan, or with targets for POST /plan_multistep; - is standard input.",
    target="Position (m) and velocity (m/s) to reach.",
    system="A machine's name (see breakaway models --machines), or an object with the plant's "
    "parameters.  [default: the paper's plant]",
    uncertainty="Plan for plants that are not known: those in a FILE of breakaway identify --json, "
    'or by what share parameters may be off, such as {"relative": {"coulomb_friction": 0.1}}.',
)
@click.option(
    "--horizon", type=int, help="H: time steps of the plan.  [default: 64, or the named model's]"
)
@click.option(
    "--pending-controls",
    metavar="JSON",
    help="Controls on their way to the actuator already, such as [0, 0] at rest with a delay of 2.",
)
@click.option(
    "--method",
    metavar="NAME|JSON",
    help="A method's name, such as cem, or an object with its name and options.  "
    "[default: action_diffusion]",
)
@click.option(
    "--num-candidates",
    type=int,
    help="K: candidates that are rolled out and ranked.  [default: 16]",
)
@click.option(
    "--model",
    metavar="NAME",
    help="A model's name, or name/version.  [default: the one that fits the plant]",
)
@click.option(
    "--refine",
    is_flag=True,
    default=None,
    help="Descend from the candidates to a plan that arrives.",
)
@click.option(
    "--objective",
    metavar="NAME",
    help="What ranks plans that arrive equally well, such as control_energy.  "
    "[default: terminal_error]",
)
@json_option
@picture_option("Draw a plan to one target")
def plan(
    request_file: BinaryIO | None, json_file: Path | None, picture: Path | None, **fields: Any
) -> None:
    """Make one plan, without a server, and print its measures.

    What to plan is said by a file (--request), by options with the names of its fields, or by
    both: an option overrides what the file says, and --target-state its targets, too.

    \b
    breakaway plan --target-state 0.2 0 --refine
    breakaway plan --target-state 0.01 0 --system emps --method dataset_prior --refine
    breakaway plan --target-state 0.2 0 --refine --uncertainty '{"relative": {"bias": 0.1}}'
    breakaway plan --request request.json --seed 7 --json plan.json
    """
    from rich.console import Console

    from app.cli.plan_request import read_request
    from app.cli.plan_table import print_plan

    options = {name: value for name, value in fields.items() if value is not None}
    request = read_request(request_file, options)
    if json_file and json_file != STANDARD_OUTPUT:
        check_writable("--json", json_file)
    if picture:
        from app.cli.plan_picture import check_picture, write_picture

        check_picture(request, picture)
        check_writable("--picture", picture)
    answer = _make_plan(request, options, with_candidates=picture is not None)
    print_plan(Console(stderr=json_file == STANDARD_OUTPUT), request, answer)
    if json_file:
        _write_json(request, answer, json_file)
    if picture:
        write_picture(request, answer, picture)


def _make_plan(
    request: "PlanRequest | MultistepPlanRequest",
    options: Mapping[str, Any],
    with_candidates: bool,
) -> "PlanResponse | MultistepPlanResponse":
    """Plan as the service does, with its settings and models.

    Args:
        request: what to plan.
        options: those of its fields that were given as options, for the names in errors.
        with_candidates: whether the answer has candidates where the request does not ask for them.

    Raises:
        Failure: the models are not in order, or refuse the request; or planning failed.
    """
    from app.cli.plan_request import source
    from app.inference.model_store import ModelStore, UnfitModel, UnknownModel
    from app.inference.verification import ModelRejected
    from app.planning.methods.base import InvalidStepCount
    from app.planning.methods.settling import needs_model
    from app.planning.problem import PlanningError
    from app.serving.kernels import PLANNING, prepare
    from app.serving.rates import Rates
    from app.serving.refusals import InvalidField
    from app.serving.service import PlanningService
    from app.settings import PLAN_SETTINGS
    from app.wire.requests import MultistepPlanRequest

    if with_candidates:
        request = request.model_copy(update={"include": [*request.include, "candidates"]})
    answer: PlanResponse | MultistepPlanResponse
    settings = read_settings(PLAN_SETTINGS)
    prepare(PLANNING)
    try:
        with ExitStack() as stack:
            models, engine = ModelStore([]), None
            if request.model or needs_model(request.recipe().method):
                models, engine = _load_models(request, settings, stack)
            service = PlanningService(settings, models, engine, Rates())
            # Twice: the time in the answer is to be the plan's, and not that of loading kernels.
            for asked in (request.model_copy(update={"num_candidates": 1}), request):
                if isinstance(asked, MultistepPlanRequest):
                    answer = service.plan_multistep(service.resolve(asked))
                else:
                    answer = service.plan(service.resolve(asked))
            return answer
    except InvalidField as error:
        raise Failure(f"{source(error.pointer, options)}: {error}") from None
    except UnknownModel as error:
        raise Failure(f"{source('/model', options)}: {error}") from None
    except UnfitModel as error:
        raise Failure(f"{source('/system', options)}: {error}") from None
    except InvalidStepCount as error:
        raise Failure(f"{source('/method/steps', options)}: {error}") from None
    except (ModelRejected, PlanningError) as error:
        raise Failure(str(error)) from None


def _load_models(
    request: "PlanRequest | MultistepPlanRequest", settings: "Settings", stack: ExitStack
) -> "tuple[ModelStore, Engine]":
    """Load the models that a request may need; all of them if it needs none that there is.

    Raises:
        ModelRejected: a model is not what its manifest says.
    """
    from app.compilation.parts import are_kept
    from app.inference.device import choose_device
    from app.inference.engine import Engine
    from app.inference.manifest import Manifest
    from app.inference.networks import KINDS
    from app.planning.plant.system import System
    from app.planning.problem import DEFAULT_HORIZON
    from app.serving.kernels import NETWORK, available_cores

    def is_wanted(manifest: Manifest) -> bool:
        if request.model:
            return manifest.is_called(request.model)
        horizon = request.horizon or DEFAULT_HORIZON
        return manifest.covers(request.system or System(), horizon)

    engine = stack.enter_context(closing(Engine(available_cores())))
    # One plan is made sooner by TorchScript than a network is compiled.
    kinds = KINDS if are_kept(NETWORK) else KINDS[-1:]
    models = engine.load(settings.model_store, choose_device(), kinds, (), is_wanted)
    if not models.models:
        models = engine.load(settings.model_store, choose_device(), kinds, ())
    return models, engine


def _write_json(
    request: "PlanRequest | MultistepPlanRequest",
    answer: "PlanResponse | MultistepPlanResponse",
    file: Path,
) -> None:
    not_asked_for = {"candidates"} - set(request.include)
    text = answer.model_dump_json(exclude_none=True, exclude=not_asked_for, indent=1)
    write_text("--json", file, text)
