"""Decks too large to be meant: refused before the work that they would cost, in few words."""

import os
import re
from pathlib import Path

import pytest

from lapwing.deck import DeckError, load_deck, parser, problems

PLAIN = (Path(__file__).parent / "accepted" / "plain.nml").read_text(encoding="utf-8")


def refusal(tmp_path, text, overrides=()):
    path = tmp_path / "deck.nml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(DeckError) as caught:
        load_deck(path, overrides)
    assert len(str(caught.value)) < 25_000
    assert len(caught.value.problems) <= 200
    return [str(problem).removeprefix(f"{path}:") for problem in caught.value.problems]


@pytest.mark.parametrize(("text", "message"), [
    ("&sweep values =" + " 1" * 10**6 + " /",
     "1:200019: more values in a list than expected (at most 100000)"),
    ("&sweep values = " + "1,\n" * 10**6 + " /",
     "100002:1: more values in a list than expected (at most 100000)"),
    ("& " * 50_000, "1:2001: expected at most 1000 groups in a deck"),
    ("&response\n" + "x = 1\n" * 20_000 + "/", "10002:3: expected at most 10000 keys in a deck"),
    ("&response\n" + ("x =" + " 1" * 90_000 + "\n") * 3 + "/",
     "4:39997: expected at most 200000 words in a deck"),
    ("!" * 4_000_001, " 4000001 bytes; expected at most 4000000: no deck needs more"),
], ids=["list", "lines", "groups", "keys", "words", "bytes"])
def test_limits_come_before_parsing(tmp_path, monkeypatch, text, message):
    def parse():
        raise AssertionError("parsed")

    monkeypatch.setattr(parser, "_parser", parse)
    assert refusal(tmp_path, text) == [message]


def test_an_override_has_the_same_limits(tmp_path):
    [problem] = refusal(tmp_path, PLAIN, [("operation.brake_torque", "1 " * 200_000)])
    assert problem.endswith("more values in a list than expected (at most 100000)")
    assert len(problem) < 300


def test_a_list_of_the_greatest_length_is_read(tmp_path):
    path = tmp_path / "deck.nml"
    values = " ".join(map(str, range(1, 20_001)))
    path.write_text(PLAIN + f"\n&sweep values = {values} 80000*1 name = 'long' "
                    "parameter = 'brake_torque' settle_cycles = 1 /\n", encoding="utf-8")
    assert load_deck(path).sweeps[-1].values.size == 20_000


@pytest.mark.parametrize(("value", "part"), [
    ("100000000*1.0", "100000000*1.0; expected a repeat count from 1 to 100000"),
    ("9" * 10_000, "too large for double precision"),
    ("9" * 10_000 + "*1", "expected a repeat count from 1 to 100000"),
    ("x" * 10_000, "brake_torque = xxx"),
    ("'" + "x" * 10_000 + "'", "a number stands without quotes"),
    ("1 " + "x " * 10_000, "brake_torque = 1 x x"),
    ("9" * 10_000 + "Nm", "text after a number"),
])
def test_quoted_values_are_cut(tmp_path, value, part):
    text = re.sub("brake_torque = [0-9.]+", f"brake_torque = {value}", PLAIN)
    problems = refusal(tmp_path, text)
    assert part in problems[0]
    assert max(map(len, problems)) < 1000


@pytest.mark.parametrize("text", ["&gear_pair " + "x " * 50_000, "&a / " * 900, "/ " * 50_000,
                                  "&gear_pair\n" + "x = 1\n" * 9000, "= " * 5000, "# \n" * 5000])
def test_messages_are_bounded(tmp_path, text):
    assert len(refusal(tmp_path, text)) < 100


@pytest.mark.parametrize(("make", "words"), [
    (os.mkdir, "a folder; expected a file"), (os.mkfifo, "a named pipe; expected a file"),
    (lambda path: path.symlink_to(path), "symbolic links that lead in a circle"),
])
def test_a_deck_that_is_no_file(tmp_path, make, words):
    path = tmp_path / "deck.nml"
    make(path)
    with pytest.raises(DeckError) as caught:
        load_deck(path)
    assert str(caught.value) == f"{path}: cannot be read: {words}"


@pytest.mark.parametrize("count", ["1000000000000", "2 100000"])
def test_ranges_are_not_written_out(tmp_path, count):
    ends = "0" + " 0" * count.count(" "), "1" + " 1" * count.count(" ")
    problems = refusal(tmp_path, PLAIN + f"&sweep name = 'long' parameter = 'brake_torque' "
                       f"from = {ends[0]} to = {ends[1]} count = {count} /")
    assert "100000" in problems[0]
    assert len(problems) == 1


def test_what_is_counted_and_not_listed_is_refused_all_the_same(tmp_path):
    groups = "".join(f"&response name = 'r{i}' settle_cycles = x /\n" for i in range(60))
    problems = refusal(tmp_path, PLAIN.replace("&response name = 'a' /", groups))
    assert len(problems) == 20
    assert problems[-1].endswith("(... and 40 more of this kind)")


@pytest.mark.parametrize("separator", [", ", ",", " ,\n  ", ",\n", ", ! why\n", ",,", " "])
def test_words_of_a_long_list_know_their_places(separator):
    """Many numbers are one token of the grammar; a word is what the text holds at its place."""
    numbers = [f"{sign}{i}.5{exponent}" for i in range(12) for sign in ("", "-")
               for exponent in ("", "e-3")]
    text = "&sweep\n values = 7, " + separator.join([*numbers, "12abc", *numbers, "'x'"]) + "\n/"
    group, = parser.parse(text, "deck", problems.Report())
    words = group.entries["values"].words
    assert [word.text for word in words if word.kind != "COMMA"] \
        == ["7", *numbers, "12abc", *numbers, "'x'"]
    assert len(words) == len(re.findall(r"[^\s,]+|,", re.sub("!.*", "", text))) - 4
    for word in words:
        assert text[word.start:word.end] == word.text
        before = text[:word.start]
        assert word.place == ("deck", before.count("\n") + 1, word.start - before.rfind("\n"))
