"""An evaluation from end to end: ask what is missing, then write the report."""

from collections.abc import Callable, Sequence
from contextlib import AbstractAsyncContextManager
from datetime import UTC, datetime, timedelta
from pathlib import Path

import matplotlib
import pandas as pd
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

from app.client.planner_client import AsyncPlannerClient
from app.evaluation.answer_log import AnswerLog, EvaluationError, Session
from app.evaluation.ask import ask_all
from app.evaluation.estimate import measure_rates
from app.evaluation.question import Question
from app.evaluation.report import write_report
from app.evaluation.suite import Suite
from app.figures.style import STYLE_FILE
from app.planning.plant.system import System
from app.planning.problem import DEFAULT_HORIZON
from app.wire.about import ModelDescription

Connect = Callable[[], AbstractAsyncContextManager[AsyncPlannerClient]]


async def evaluate(
    suites: Sequence[Suite],
    connect: Connect,
    directory: Path,
    concurrency: int,
    console: Console,
) -> Path:
    """Ask for what `directory` lacks of the suites' answers, and write the report.

    Args:
        suites: in the order of the report.
        connect: opens a client; a complete folder needs none.
        directory: keeps the answers, and takes the report.
        concurrency: most requests under way at once.
        console: shows what goes on.

    Returns:
        The report's Markdown file.

    Raises:
        EvaluationError: the folder's answers are damaged, in use or of another service.
        RequestRefused: the service says no.
        httpx.TransportError: it cannot be reached.
        OSError: the folder cannot be written to.
    """
    with AnswerLog(directory) as log:
        questions = [list(suite.questions()) for suite in suites]
        missing = _missing(questions, log)
        if any(missing):
            async with connect() as client:
                await _complete(client, suites, missing, log, concurrency, console)
        report = _report(suites, questions, log, directory)
        log.pack()
    return report


def _missing(questions: list[list[Question]], log: AnswerLog) -> list[list[Question]]:
    """Return each suite's questions without an answer; what two suites ask counts for the first."""
    asked: set[str] = set()
    missing = []
    for of_suite in questions:
        own = {
            question.key: question
            for question in of_suite
            if question not in log and question.key not in asked
        }
        asked |= own.keys()
        missing.append(list(own.values()))
    return missing


async def _complete(
    client: AsyncPlannerClient,
    suites: Sequence[Suite],
    missing: list[list[Question]],
    log: AnswerLog,
    concurrency: int,
    console: Console,
) -> None:
    await client.wait_until_ready()
    info, models = await client.info(), await client.models()
    questions = [question for of_suite in missing for question in of_suite]
    _check_models(questions, info.nominal_system, models)
    log.begin(
        Session(
            began=datetime.now(UTC),
            version=info.version,
            machine=info.machine,
            device=info.device,
            network_threads=info.network_threads,
            libraries=info.libraries,
            models={f"{model.name}/{model.version}": model.sha256 for model in models},
            concurrency=concurrency,
        )
    )
    network = any(question.cost.network_evaluations for question in questions)
    rates = await measure_rates(client, network=network)
    total = sum(rates.seconds(question) for question in questions) / concurrency
    console.print(
        f"{len(questions)} requests, about {timedelta(seconds=round(total))} at "
        f"{concurrency} at once; interrupted, the same command goes on"
    )
    columns = (TextColumn("{task.description:24}"), BarColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console) as progress:
        overall = progress.add_task("all", total=sum(map(rates.seconds, questions)))
        for suite, of_suite in zip(suites, missing, strict=True):
            bar = progress.add_task(suite.name, total=sum(map(rates.seconds, of_suite)))

            def advance(question: Question, bar: TaskID = bar) -> None:
                for one in (overall, bar):
                    progress.advance(one, rates.seconds(question))

            await ask_all(client, of_suite, log, concurrency, advance)


def _check_models(
    questions: list[Question], nominal: System, models: list[ModelDescription]
) -> None:
    """Find out now, and not after hours, that a plant has no model."""
    for question in questions:
        request = question.request
        system = request.system or nominal
        horizon = request.horizon or DEFAULT_HORIZON
        if question.cost.network_evaluations and not any(
            model.covers(system, horizon) for model in models
        ):
            raise EvaluationError(f"the service has no model that was trained for {system}")


def _report(
    suites: Sequence[Suite], questions: list[list[Question]], log: AnswerLog, directory: Path
) -> Path:
    sections, data = {}, {}
    with matplotlib.rc_context(fname=STYLE_FILE):
        for suite, of_suite in zip(suites, questions, strict=True):
            answered = [(question, log[question]) for question in of_suite]
            rows = [row for question, answer in answered for row in suite.rows(question, answer)]
            data[suite.name] = pd.DataFrame(rows)
            sections[suite.name] = suite.section(data[suite.name], answered)
        first = suites[0]
        return write_report(
            directory,
            log.sessions[0],
            [session.concurrency for session in log.sessions],
            f"seed {first.seed}{', quick: sizes cut down, numbers mean little' * first.quick}",
            sections,
            data,
        )
