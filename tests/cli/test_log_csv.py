"""Text with columns as spreadsheets and loggers write it, and what is wrong with it in words."""

from pathlib import Path

import numpy as np
import pytest

from app.cli.log_csv import read_csv
from app.failure import Failure


def written(folder: Path, text: str, encoding: str = "utf-8") -> Path:
    file = folder / "log.csv"
    file.write_text(text, encoding=encoding)
    return file


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig"])
@pytest.mark.parametrize(
    "text",
    [
        "t [s],u [V]\n0.0,1.5\n0.1,-2\n",
        "# axis 7\n\nt [s], u [V]\n0.0, 1.5 # rough\n0.1, -2\n",
        "t [s];u [V]\n0,0;1,5\n0,1;-2\n",
        "t [s];u [V]\n0.0;1.5\n0.1;-2;\n",
        "t [s]\tu [V]\n0,0\t1,5\n0,1\t-2\n",
        't [s],u [V]\n"0,0","1,5"\n"0,1",-2\n',
    ],
)
def test_columns_are_read_by_their_headings(tmp_path: Path, text: str, encoding: str) -> None:
    columns = read_csv(written(tmp_path, text, encoding))
    assert list(columns) == ["t [s]", "u [V]"]
    assert columns["t [s]"].tolist() == [0.0, 0.1]
    assert columns["u [V]"].tolist() == [1.5, -2.0]


@pytest.mark.parametrize("text", ["0 1.5\n0.1 -2\n", "0;1,5\n0,1;-2\n", "0,1.5\n0.1,-2\n"])
def test_without_headings_columns_have_numbers(tmp_path: Path, text: str) -> None:
    columns = read_csv(written(tmp_path, text))
    assert {name: values.tolist() for name, values in columns.items()} == {
        "0": [0.0, 0.1],
        "1": [1.5, -2.0],
    }


def test_what_is_no_number_is_told_apart(tmp_path: Path) -> None:
    columns = read_csv(written(tmp_path, 'a;b;c\n1;x;1,200.5\n2;3;"999.5"\n3\n'))
    np.testing.assert_equal(columns["a"], [1.0, 2.0, 3.0])
    np.testing.assert_equal(columns["b"], [np.nan, 3.0, np.nan])
    np.testing.assert_equal(columns["c"], [np.nan, 999.5, np.nan])


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "there is nothing in it"),
        ("t,u\n", "no rows below the headings t, u"),
        ("t,u\n0,00,1,50\n", "row 1 has 4 values for 2 columns: a decimal comma?"),
    ],
)
def test_what_has_no_columns_is_refused(tmp_path: Path, text: str, reason: str) -> None:
    with pytest.raises(Failure, match=reason.replace("?", "[?]")):
        read_csv(written(tmp_path, text))
