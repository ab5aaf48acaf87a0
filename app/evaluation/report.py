"""From sections to files that a person wants: Markdown and HTML, LaTeX tables, figures, CSV."""

from collections.abc import Iterator, Mapping, Sequence
from html import escape
from pathlib import Path
from string import Template

import pandas as pd
from markdown_it import MarkdownIt
from tabulate import tabulate

from app.evaluation.answer_log import Session
from app.evaluation.section import Picture, Section, Table

TITLE = "Breakaway: evaluation"
PAGE = Template(Path(__file__).with_name("page.html").read_text())


def write_report(
    directory: Path,
    session: Session,
    concurrencies: Sequence[int],
    settings: str,
    sections: Mapping[str, Section],
    data: Mapping[str, pd.DataFrame],
) -> Path:
    """Write the whole report; return its Markdown file.

    Args:
        directory: takes `report.md`, `report.html` and the folders `tables`, `figures` and `data`.
        session: who answered.
        concurrencies: requests under way at once, in each session.
        settings: of the evaluation.
        sections: by the suites' names.
        data: by the suites' names.

    Raises:
        OSError: a file cannot be written.
    """
    for name in ("tables", "figures", "data"):
        (directory / name).mkdir(parents=True, exist_ok=True)
    for section in sections.values():
        for table in section.tables:
            (directory / "tables" / f"{table.name}.tex").write_text(_latex(table))
        for picture in section.pictures:
            _save(picture, directory / "figures")
    for name, frame in data.items():
        frame.to_csv(directory / "data" / f"{name}.csv", index=False)
    text = "\n".join(_markdown(session, concurrencies, settings, list(sections.values())))
    body = MarkdownIt("commonmark").enable("table").render(text)
    (directory / "report.html").write_text(PAGE.substitute(title=escape(TITLE), body=body))
    report = directory / "report.md"
    report.write_text(text)
    return report


def _markdown(
    session: Session, concurrencies: Sequence[int], settings: str, sections: list[Section]
) -> Iterator[str]:
    yield f"# {TITLE}\n"
    yield from _header(session, concurrencies, settings)
    if any(section.claims for section in sections):
        yield "\n## What the paper says, and what we find"
    for section in sections:
        if section.claims:
            yield f"\n### {section.title}\n"
        for claim in section.claims:
            verdict = "Confirmed" if claim.confirmed else "Not confirmed"
            yield f"- **{verdict}.** *{claim.statement}* {claim.evidence}"
    for section in sections:
        yield f"\n## {section.title}\n"
        yield f"{section.introduction}\n"
        for picture in section.pictures:
            yield f"![{picture.caption}](figures/{picture.name}.png)\n"
            yield f"*{picture.caption}* ([PDF](figures/{picture.name}.pdf))\n"
        for table in section.tables:
            yield f"{table.caption}\n"
            yield tabulate(table.rows, table.headings, tablefmt="pipe", disable_numparse=True)
            yield ""


def _header(session: Session, concurrencies: Sequence[int], settings: str) -> Iterator[str]:
    libraries = ", ".join(f"{name} {number}" for name, number in session.libraries.items())
    at_once = ", ".join(str(number) for number in sorted(set(concurrencies)))
    yield f"- Breakaway {session.version} ({libraries}), asked on {session.began:%Y-%m-%d}"
    yield f"- {session.machine}; network on {session.device} with {session.network_threads} threads"
    yield f"- {settings}; requests under way at once: {at_once}"
    for model, sha256 in session.models.items():
        yield f"- model {model}, sha256 `{sha256}`"


def _latex(table: Table) -> str:
    tabular = tabulate(table.rows, table.headings, tablefmt="latex_booktabs", disable_numparse=True)
    return f"% {table.caption}\n{tabular}\n".replace("±", r"$\pm$")


def _save(picture: Picture, folder: Path) -> None:
    picture.figure.savefig(folder / f"{picture.name}.png")
    picture.figure.savefig(folder / f"{picture.name}.pdf", metadata={"CreationDate": None})
