"""Tables as other programs leave them, in tables/: read, or refused with exactly these lines."""

import os
import re
from pathlib import Path

import pytest

from lapwing import TransmissionError
from lapwing.deck import DeckError, load_deck
from lapwing.model.transmission_error.file import (
    MAX_BYTES,
    MAX_ROWS,
    TransmissionErrorFileError,
    read_columns,
)

TABLES = Path(__file__).with_name("tables")
DECK = (TABLES.parent / "accepted" / "plain.nml").read_text(encoding="utf-8")
LAYOUT = "'phase,transmission_error,slope'"
NUMBER = "transmission_error is {!r}; expected a finite number"
READ = {
    "utf16_with_mark": [1e-5, 2e-5, 1e-5], "quoted_header": [1e-5, 2e-5, 1e-5],
    "empty_rows_at_end": [1e-5, 2e-5, 1e-5], "mark_and_old_line_ends": [1e-5, 2e-5, 1e-5],
    "quoted_fields": [-52e-6, -8e-6, 11e-6]}
REFUSED = {
    "unit_in_latin1": ["1:26: not UTF-8 text, byte 0xb5; expected a file saved as UTF-8"],
    "nul_byte": ["3:4: not text, byte 0x00; expected a file saved as UTF-8"],
    "separator_row": ["1:1: 'sep=,' is no header; leave this row out, expected the names of the "
                      f"columns, for example {LAYOUT}"],
    "semicolons": ["1: the separator is ';'; expected a comma (and a point, not a comma, in "
                   "numbers)"],
    "decimal_commas_quoted": ["2:1: decimal comma in '0,0'; expected a point "
                              "(... and 3 more numbers)"],
    "underscore_in_number": ["2:2: " + NUMBER.format("1_0e-6")],
    "other_digits": ["3:1: phase is '0.2_5'; expected a finite number",
                     "3:2: " + NUMBER.format("٢e-5")],
    "not_representable": [
        "2:2: " + NUMBER.format("1e-999") + ": too small for double precision",
        "3:2: " + NUMBER.format("1e999") + ": too large for double precision",
        "4:2: " + NUMBER.format("\u22121e-5") + ": the minus sign is not the one of the keyboard",
        "5:2: " + NUMBER.format("nan") + ": NaN and infinity are refused"],
    "empty_row_between": ["3: an empty row between rows; expected numbers"],
    "quote_not_closed": ["2: the closing quote is missing on this line"],
    "whole_turn": ["17:1: phase is 1.04167 periods; expected 0 <= phase < 1, one mesh period, "
                   "where this table goes on to 24.93 (... and 344 more rows)"]}


def test_every_table_is_listed():
    assert {path.stem for path in TABLES.iterdir()} == {*READ, *REFUSED}


@pytest.mark.parametrize("name", READ)
def test_read(name):
    columns, problems = read_columns(TABLES / f"{name}.csv", 25, 32)
    assert problems == []
    assert columns["transmission_error"].tolist() == pytest.approx(READ[name], rel=1e-15)


def deck_of(tmp_path, file):
    """A good deck whose transmission error is `file`."""
    text, made = re.subn("parabola_amplitude = [0-9.e-]+", f"file = '{file}'", DECK)
    assert made == 1
    path = tmp_path / "deck.nml"
    path.write_text(text, encoding="utf-8")
    return path


def refusal(tmp_path, file):
    with pytest.raises(DeckError) as caught:
        load_deck(deck_of(tmp_path, file))
    return [str(problem) for problem in caught.value.problems]


@pytest.mark.parametrize("name", REFUSED)
def test_refused(tmp_path, name):
    path = TABLES / f"{name}.csv"
    assert refusal(tmp_path, path) == [f"{path}:{line}" for line in REFUSED[name]]


@pytest.mark.parametrize(("make", "words"), [
    (os.mkdir, "a folder; expected a file"), (os.mkfifo, "a named pipe; expected a file"),
    (lambda path: path.symlink_to(path), "symbolic links that lead in a circle"),
])
def test_no_file(tmp_path, make, words):
    make(tmp_path / "te.csv")
    [problem] = refusal(tmp_path, "te.csv")
    assert problem.endswith(f"file = 'te.csv' cannot be read: {words}")
    assert problem.startswith(str(tmp_path / "deck.nml") + ":")


@pytest.mark.parametrize(("text", "most", "part"), [
    ("phase,transmission_error\n" + "x,y\n" * 5000, 40, "(... and 4980 more of this kind)"),
    ("phase," * 10**6, 1, "no data"),
    ("phase," * 10**6 + "\n0,1\n", 1, "1000001 columns; expected one of"),
    ("x" * 10**6 + ",y\n0,1\n", 2, "unknown column"),
    ("phase,transmission_error\n" + "0," * 10**6 + "1\n", 1, "1000001 fields; expected 2"),
    ("phase,transmission_error\n0," + "y" * 10**6 + "\n", 1, "expected a finite number"),
    ("phase,transmission_error\n0,\"" + "y" * 10**6 + "\"\n", 1, "a field is longer than"),
    ("phase,transmission_error\n0," + "9" * 10**6 + "\n", 1, "too large for double precision"),
    ("phase,transmission_error[" + "y" * 10**6 + "]\n0,1\n", 1, "has no unit"),
    ("phase,transmission_error\n" + "0,1\n" * (MAX_ROWS + 1), 1, f"(at most {MAX_ROWS})"),
    ("#" * (MAX_BYTES + 1), 1, f"expected at most {MAX_BYTES}: one mesh period needs no more"),
], ids=range(11))
def test_messages_are_bounded(tmp_path, text, most, part):
    path = tmp_path / "te.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(TransmissionErrorFileError) as caught:
        TransmissionError.from_file(path)
    assert len(caught.value.problems) <= most
    assert len(str(caught.value)) < 20_000
    assert part in str(caught.value)
