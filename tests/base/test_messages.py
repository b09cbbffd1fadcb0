"""Messages stay a page: 20 of a kind, 200 in all, long words cut, and the rest counted."""

import re

import pytest

from lapwing.base.messages import (
    MAX_CHARACTERS,
    MAX_LENGTH,
    MAX_MESSAGES,
    MAX_OF_A_KIND,
    bounded,
    cut,
    cut_words,
    percent,
)


def shown(texts):
    return bounded(texts, str, lambda _, text: text)


def test_few_stay_as_they_are():
    texts = [f"value = {i}; expected 0" for i in range(MAX_OF_A_KIND)]
    assert shown(texts) == texts


def test_many_of_a_kind_are_counted():
    texts = [f"key = x{i}, 'q{i}' of 1e{i}" for i in range(1000)]
    texts.insert(500, "another")
    assert shown(texts) == [*texts[:19], texts[19] + " (... and 980 more of this kind)", "another"]


@pytest.mark.parametrize("length", [3, 700])
def test_no_problem_is_lost_from_the_count(length):
    letters = "abcdefghijklmnopqrstuvwxyz"
    texts = [(a + b) * (length // 2) for a in letters for b in letters]
    found = shown([text for text in texts for _ in range(2)])
    assert len(found) <= MAX_MESSAGES
    assert sum(map(len, found)) < MAX_CHARACTERS + 100
    more = re.search(r"\(\.\.\. and (\d+) more problems\)$", found[-1])
    assert len(found) + int(more[1]) == 2 * len(texts)


def test_cutting():
    assert cut("x" * 40) == "x" * 40
    assert cut("x" * 41) == "x" * 37 + "..."
    assert cut_words("a " + "x" * 1000 + " b") == "a " + "x" * 197 + "... b"
    assert len(cut_words("ab " * 1000)) == MAX_LENGTH


@pytest.mark.parametrize(("value", "words"), [
    (0.5, "50 %"), (0.0036, "0.36 %"), (1.0, "100 %"), (0.99996, "99.99 %"), (0.9914, "99.14 %"),
    (float("nan"), "not known"), (0.0, "0 %"),
    (1e-6, "0.0001 %"), (1 - 1e-6, "99.99 %"), (1 - 1e-15, "100 %")])
def test_nearly_all_is_not_all(value, words):
    assert percent(value) == words
