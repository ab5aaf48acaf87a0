"""An evaluation from end to end: ask what is missing, then write the report."""

from collections.abc import Callable, Sequence
from contextlib import AbstractAsyncContextManager
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TypeAlias

import matplotlib
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from app.client.planner_client import AsyncPlannerClient
from app.evaluation.answer_log import AnswerLog, Session
from app.evaluation.ask import ask_all
from app.evaluation.estimate import measure_rates
from app.evaluation.question import Question
from app.evaluation.report import write_report
from app.evaluation.served import ServedModels
from app.evaluation.suite import Suite
from app.figures.style import STYLE_FILE

Wanted: TypeAlias = dict[str, tuple[Suite, Question]]
"""All that is asked, and by whom first, by the question's key."""
Connect: TypeAlias = Callable[[], AbstractAsyncContextManager[AsyncPlannerClient]]


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
        questions = {suite: list(suite.questions()) for suite in suites}
        # What two suites ask is asked once, for the first.
        wanted: Wanted = {}
        for suite, asked in questions.items():
            for question in asked:
                wanted.setdefault(question.key, (suite, question))
        if any(question not in log for _, question in wanted.values()):
            async with connect() as client:
                await _complete(client, wanted, log, concurrency, console)
        settings = f"seed {suites[0].seed}"
        if suites[0].quick:
            settings += ", quick: sizes cut down, numbers mean little"
        with matplotlib.rc_context(fname=STYLE_FILE):
            sections = [suite.section(log.answered(asked)) for suite, asked in questions.items()]
            report = write_report(directory, log.sessions, settings, sections)
        log.pack()
    return report


async def _complete(
    client: AsyncPlannerClient,
    wanted: Wanted,
    log: AnswerLog,
    concurrency: int,
    console: Console,
) -> None:
    await client.wait_until_ready()
    info, models = await client.info(), await client.models()
    served = ServedModels(info.nominal_system, models)
    questions: list[Question] = []
    uncovered: list[Question] = []
    for _, question in wanted.values():
        answer = log.get(question)
        if question in log and not served.answers_otherwise(question, answer and answer.model):
            continue
        left_out = question.if_covered and not served.can_answer(question)
        (uncovered if left_out else questions).append(question)
    # Now, and not after hours: a plant may have no model.
    costs = {question.key: served.cost(question) for question in questions}
    about = {
        "began": datetime.now(UTC),
        "models": {model.label: model.sha256 for model in models},
        "concurrency": concurrency,
    }
    log.begin(Session.model_validate(info.model_dump() | about))
    for question in uncovered:
        log.leave_out(question)
    network = any(cost.network_evaluations for cost in costs.values())
    rates = await measure_rates(client, served, network=network)
    seconds = {question.key: rates.seconds(question, costs[question.key]) for question in questions}
    total = sum(seconds.values())
    console.print(
        f"{len(questions)} requests, about {timedelta(seconds=round(total / concurrency))} at "
        f"{concurrency} at once; interrupted, the same command goes on"
    )
    columns = (TextColumn("{task.description:24}"), BarColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console) as progress:
        bar = progress.add_task("", total=total)

        def advance(question: Question) -> None:
            suite, _ = wanted[question.key]
            progress.update(bar, advance=seconds[question.key], description=suite.name)

        await ask_all(client, questions, log, concurrency, advance)
