"""From sections to files that a person wants: Markdown and HTML, LaTeX tables, figures, CSV."""

from collections.abc import Iterator, Sequence
from html import escape
from pathlib import Path
from string import Template

from markdown_it import MarkdownIt
from tabulate import tabulate

from app.evaluation.answer_log import Session
from app.evaluation.suite import Claim, Picture, Section, Table

TITLE = "Breakaway: evaluation"
PAGE = Template(Path(__file__).with_name("page.html").read_text())


def write_report(
    directory: Path, sessions: Sequence[Session], settings: str, sections: Sequence[Section]
) -> Path:
    """Write the whole report; return its Markdown file.

    Args:
        directory: takes `report.md`, `report.html` and the folders `tables`, `figures` and `data`.
        sessions: who answered.
        settings: of the evaluation.
        sections: in their order.

    Raises:
        OSError: a file cannot be written.
    """
    for name in ("tables", "figures", "data"):
        (directory / name).mkdir(parents=True, exist_ok=True)
    for section in sections:
        section.data.to_csv(directory / "data" / f"{section.name}.csv", index=False)
        for table in section.all(Table):
            stem = "-".join(filter(None, (section.name, table.part)))
            (directory / "tables" / f"{stem}.tex").write_text(_latex(table))
        for picture in section.all(Picture):
            file = directory / "figures" / section.name
            picture.figure.savefig(file.with_suffix(".png"))
            picture.figure.savefig(file.with_suffix(".pdf"), metadata={"CreationDate": None})
    text = "\n".join([*_header(sessions, settings), *_verdicts(sections), *_sections(sections)])
    body = MarkdownIt("commonmark").enable("table").render(text)
    (directory / "report.html").write_text(PAGE.substitute(title=escape(TITLE), body=body))
    report = directory / "report.md"
    report.write_text(text)
    return report


def _header(sessions: Sequence[Session], settings: str) -> Iterator[str]:
    first, last = sessions[0], sessions[-1]
    days = dict.fromkeys(f"{session.began:%Y-%m-%d}" for session in (first, last))
    models = {name: sha256 for session in sessions for name, sha256 in session.models.items()}
    libraries = ", ".join(f"{name} {number}" for name, number in first.libraries.items())
    at_once = ", ".join(map(str, sorted({session.concurrency for session in sessions})))
    yield f"# {TITLE}\n"
    yield f"- Breakaway {first.version} ({libraries}), asked on {' to '.join(days)}"
    yield f"- {first.machine}; network on {first.device} with {first.network_threads} threads"
    yield f"- {settings}; requests under way at once: {at_once}"
    for model, sha256 in sorted(models.items()):
        yield f"- model {model}, sha256 `{sha256}`"


def _verdicts(sections: Sequence[Section]) -> Iterator[str]:
    with_claims = [section for section in sections if section.all(Claim)]
    if with_claims:
        yield "\n## What the paper says, and what we find"
    for section in with_claims:
        yield f"\n### {section.title}\n"
        for claim in section.all(Claim):
            verdict = "Confirmed" if claim.confirmed else "Not confirmed"
            yield f"- **{verdict}.** *{claim.statement}* {claim.evidence}"


def _sections(sections: Sequence[Section]) -> Iterator[str]:
    for section in sections:
        yield f"\n## {section.title}\n"
        for text in section.all(str):
            yield f"{text}\n"
        for picture in section.all(Picture):
            yield f"![{picture.caption}](figures/{section.name}.png)\n"
            yield f"*{picture.caption}*\n"
        for table in section.all(Table):
            yield f"{table.caption}\n"
            yield tabulate(table.rows, table.headings, tablefmt="pipe", disable_numparse=True)
            yield ""


def _latex(table: Table) -> str:
    tabular = tabulate(table.rows, table.headings, tablefmt="latex_booktabs", disable_numparse=True)
    return f"% {table.caption}\n{tabular}\n".replace("±", r"$\pm$")
