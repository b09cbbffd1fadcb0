"""What is wrong with a deck, and where."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import NamedTuple

from lapwing.base.messages import bounded, cut_words


class Place(NamedTuple):
    """A position in a source: a file, or an override from the command line (line 0)."""

    file: str
    line: int = 0
    column: int = 0


@dataclass(frozen=True)
class Problem:
    """One refusal or warning.

    Attributes
    ----------
    file : str, the file as it was named, or `--set key=value`
    line, column : int, from 1; 0 where the whole file, line or override is concerned
    text : str, what is wrong and what is expected
    warning : bool, True where the deck is accepted all the same
    """

    file: str
    line: int
    column: int
    text: str
    warning: bool = False

    def __str__(self) -> str:
        numbers = [str(n) for n in (self.line, self.column) if n]
        return ":".join([self.file, *numbers]) + f": {'warning: ' * self.warning}{self.text}"


class DeckError(ValueError):
    """Every problem of one deck at once.

    Attributes
    ----------
    problems : tuple of Problem, in the order of the deck
    """

    def __init__(self, problems: tuple[Problem, ...]) -> None:
        self.problems = tuple(problems)
        super().__init__("\n".join(map(str, self.problems)))


class Report:
    """Collects problems; the same one is kept once.

    Attributes
    ----------
    refusals : int, how many of the problems, warnings aside, are there so far
    """

    def __init__(self) -> None:
        self._found: dict[Problem, None] = {}
        self.refusals = 0

    def add(self, place: Place, text: str, warning: bool = False) -> None:
        """Note a problem at a `Place`."""
        problem = Problem(place.file, place.line, place.column, cut_words(text), warning)
        self.refusals += not warning and problem not in self._found
        self._found[problem] = None

    @property
    def errors(self) -> tuple[Problem, ...]:
        """What makes the deck refused, in order of file and position; no more than a page."""
        return _ordered(p for p in self._found if not p.warning)

    @property
    def warnings(self) -> tuple[Problem, ...]:
        """What the user must know although the deck is accepted."""
        return _ordered(p for p in self._found if p.warning)


def _ordered(unordered: Iterable[Problem]) -> tuple[Problem, ...]:
    problems = list(unordered)
    files = list(dict.fromkeys(p.file for p in problems))
    rank = {file: i for i, file in enumerate(files)}
    problems.sort(key=lambda p: (rank[p.file], p.line, p.column))
    return tuple(bounded(problems, lambda p: p.text, lambda p, text: replace(p, text=text)))
