"""The report's files: what a reader of each finds there, and the same bytes every time."""

import re
from pathlib import Path

import matplotlib
import pandas as pd
import pytest

from app.evaluation.report import write_report
from app.evaluation.suite import Claim, Picture, Section, Table
from app.figures.style import PAGE_INCHES, STYLE_FILE, new_figure
from tests.evaluation.fakes import SHA256, session

HEADINGS = ("Method", "Share_won", "Error & floor (m)")
ROWS = (("CEM (40 it.)", "50 %", "0.1 ± 0.2"), ("A < B, #1 $x^2$ {c} ~ \\d", "", "-0.3 [-1, +1]"))
DATA = pd.DataFrame({"entrant": ["CEM (40 it.)"] * 2, "error": [0.1, 1 / 3], "run": [0, 1]})


def section() -> Section:
    figure = new_figure(2.0)
    axes = figure.subplots()
    axes.plot([1, 2, 4], [0.1, 0.2, 0.3], label="error ± spread")
    axes.set_xscale("log")
    axes.legend()
    return Section(
        "sequences",
        "Sequences",
        (
            "From rest to rest.",
            Table("Mean ± standard deviation, 95 %.", HEADINGS, ROWS),
            Table("One cell.", ("Only",), (("cell",),), part="one"),
            Picture("Error over K.", figure),
            Claim("It is better.", True, "By 0.1 m."),
            Claim("It is faster.", False, "By no means."),
        ),
        DATA,
    )


def written(directory: Path, *sections: Section) -> Path:
    sessions = [session(concurrency=number) for number in (4, 1, 4)]
    with matplotlib.rc_context(fname=STYLE_FILE):
        return write_report(directory, sessions, "seed 7", sections or [section()])


def test_the_markdown_shows_who_answered_and_everything_found(tmp_path: Path) -> None:
    text = written(tmp_path).read_text()
    for shown in (
        "# Breakaway: evaluation",
        "Breakaway 1.2.3 (python 3.11), asked on 2026-01-02",
        "a machine; network on cpu with 2 threads",
        "seed 7; requests under way at once: 1, 4",
        f"model tiny/1, sha256 `{SHA256}`",
        "## Sequences",
        "From rest to rest.",
        "![Error over K.](figures/sequences.png)",
        "Mean ± standard deviation, 95 %.",
    ):
        assert shown in text
    row = next(line for line in text.splitlines() if "CEM (40 it.)" in line)
    assert [cell.strip() for cell in row.strip("|").split("|")] == list(ROWS[0])


def test_the_markdown_points_only_at_the_pictures_that_it_shows(tmp_path: Path) -> None:
    text = written(tmp_path).read_text()
    assert re.findall(r"\]\((.*?)\)", text) == ["figures/sequences.png"]


def test_claims_stand_under_their_verdicts_before_the_sections(tmp_path: Path) -> None:
    text = written(tmp_path).read_text()
    claims = text[text.index("## What the paper says") : text.index("\n## Sequences")].splitlines()
    assert "- **Confirmed.** *It is better.* By 0.1 m." in claims
    assert "- **Not confirmed.** *It is faster.* By no means." in claims


def test_without_claims_the_paper_is_not_mentioned(tmp_path: Path) -> None:
    assert (
        "paper" not in written(tmp_path, Section("plain", "Plain", ["Nothing."], DATA)).read_text()
    )


def test_the_page_has_its_tables_and_pictures(tmp_path: Path) -> None:
    written(tmp_path)
    page = (tmp_path / "report.html").read_text()
    assert page.startswith("<!doctype html>")
    assert page.count("<table>") == page.count("</table>") == 2
    assert ">50 %</td>" in page
    assert "A &lt; B" in page
    assert '<img src="figures/sequences.png"' in page
    assert "<strong>Not confirmed.</strong>" in page


def cells(tex: str) -> list[list[str]]:
    """Read a LaTeX file that holds a single tabular."""
    lines = tex.splitlines()
    assert lines.pop(0).startswith("% ")
    begin = re.fullmatch(r"\\begin\{tabular\}\{(l+)\}", lines.pop(0))
    assert begin
    assert lines.pop() == r"\end{tabular}"
    assert [lines.pop(0), lines.pop(1), lines.pop()] == [r"\toprule", r"\midrule", r"\bottomrule"]
    rows = []
    for line in lines:
        assert line.endswith(r"\\")
        row = [cell.strip() for cell in re.split(r"(?<!\\)&", line.removesuffix(r"\\"))]
        assert len(row) == len(begin[1])
        rows.append(row)
    return rows


def test_latex_tables_are_tabulars_with_their_special_characters_escaped(tmp_path: Path) -> None:
    written(tmp_path)
    assert cells((tmp_path / "tables" / "sequences-one.tex").read_text()) == [["Only"], ["cell"]]
    assert cells((tmp_path / "tables" / "sequences.tex").read_text()) == [
        ["Method", r"Share\_won", r"Error \& floor (m)"],
        ["CEM (40 it.)", r"50 \%", r"0.1 $\pm$ 0.2"],
        [
            r"A \ensuremath{<} B, \#1 \$x\^{}2\$ \{c\} \textasciitilde{} \textbackslash{}d",
            "",
            "-0.3 [-1, +1]",
        ],
    ]


def test_the_data_comes_back_exactly(tmp_path: Path) -> None:
    written(tmp_path)
    pd.testing.assert_frame_equal(pd.read_csv(tmp_path / "data" / "sequences.csv"), DATA)


@pytest.mark.parametrize("ending", ["png", "pdf"])
def test_pictures_are_written_without_the_time(tmp_path: Path, ending: str) -> None:
    written(tmp_path)
    content = (tmp_path / "figures" / f"sequences.{ending}").read_bytes()
    assert content.startswith({"png": b"\x89PNG", "pdf": b"%PDF"}[ending])
    assert b"Date" not in content


def test_pictures_are_sharp_enough_to_print(tmp_path: Path) -> None:
    written(tmp_path)
    header = (tmp_path / "figures" / "sequences.png").read_bytes()[:24]
    assert int.from_bytes(header[16:20]) == 200 * PAGE_INCHES


def test_the_same_input_gives_the_same_bytes(tmp_path: Path) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    written(first)
    written(second)
    written(second)
    files = {file.relative_to(first) for file in first.rglob("*") if file.is_file()}
    assert files == {
        Path(name)
        for name in (
            "report.md",
            "report.html",
            "tables/sequences.tex",
            "tables/sequences-one.tex",
            "figures/sequences.png",
            "figures/sequences.pdf",
            "data/sequences.csv",
        )
    }
    for file in files:
        assert (first / file).read_bytes() == (second / file).read_bytes()
