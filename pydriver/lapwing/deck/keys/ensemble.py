"""Keys of &ensemble: how pairs are drawn, and what is done with each."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field

from lapwing.base import estimates
from lapwing.deck.checks.points import table_points
from lapwing.deck.deck import Asked
from lapwing.deck.declare import (
    NAME_PATTERN,
    OperationKeys,
    StudyKeys,
    figures_key,
    figures_of,
    key,
)
from lapwing.model.draw import FEWEST, correlation_problem, sampling_problems

if TYPE_CHECKING:
    from lapwing.deck.checks.assemble import Studies
    from lapwing.deck.load import _GroupReader

# Keys that say how draws are made.
_OF_DRAWS = ("sampling", "runs", "scrambles", "seed", "correlation", "sensitivity_draws")
MOST_RUNS = 10_000_000


class EnsembleKeys(OperationKeys, StudyKeys):
    """Pairs that are not all alike."""

    title = "pairs drawn by the &draw groups, or listed in a table; any number of them"

    name: str = key(text="names its figures and its part of the summary; letters, digits, . _ -",
                    example="tolerances", pattern=NAME_PATTERN, max_length=64)
    table: str | None = key(None, "CSV table in place of draws, relative to the deck: a row a run, "
                            "columns named after keys", example="points.csv", min_length=1)
    sampling: Literal["sobol", "latin_hypercube", "random"] = key(
        "sobol", "scrambled Sobol sequences and Latin hypercubes spread draws more evenly than "
        "chance; of 'random' ones intervals are exact")
    runs: int = key(1024, "pairs; as many in each scramble, with 'sobol' a power of two in each",
                    ge=2, le=1_000_000)
    scrambles: int = key(FEWEST, "independent scrambles, from which intervals follow; not with "
                         "'random'", ge=FEWEST, le=1000)
    seed: int = key(0, "decides all draws", ge=0, le=2**31 - 2)
    correlation: list[Annotated[float, Field(ge=-1, le=1)]] | None = key(
        None, "matrix, row by row in the order of the &draw groups, of the correlations of the "
        "normal variables behind the draws (a Gaussian copula)", example=[1.0, 0.5, 0.5, 1.0],
        min_length=1, max_length=400)
    sensitivity_draws: int | None = key(
        None, "n, a power of two: Sobol's main and total sensitivities from scrambles·n·(d + 2) "
        "further runs, d the number of &draw groups; left out: none", example=64, ge=FEWEST,
        le=2**16)
    settle_cycles: int = key(400, "mesh cycles before recording, in every run", ge=0,
                             le=10_000_000)
    record_cycles: int = key(100, "mesh cycles recorded in every run", ge=1, le=100_000)
    shard_runs: int | None = key(
        None, "runs of a shard, the part of the work that is kept at once; left out: some 20 s of "
        "work, and at least 64 shards; no result depends on it", example=10_000, ge=1,
        le=10_000_000)
    rtol: float | None = key(None, "relative tolerance; left out: that of &numerics, else 1e-6",
                             example=1e-6, ge=1e-13, le=1e-2)
    figures: figures_of("ensemble") | None = figures_key()  # type: ignore[valid-type]

    def build(self, builder: Studies, reader: _GroupReader) -> Asked | None:
        """See `StudyKeys`: what is drawn or listed, and oscillators at its ends."""
        report, own = builder.report, builder.own_operation(self)
        table, digest = None, ""
        if self.table is not None:
            for name in _OF_DRAWS:
                if name in reader.places:
                    report.add(reader.key_places[name], f"{name} goes with draws, not with table")
            found = table_points(self.table, builder, reader)
            if found is None:
                return None
            table, digest = found
            varied = {name: (group, np.array([values.min(), values.max()]))
                      for name, (group, values) in table.items()}
        else:
            varied = {name: (group, np.array(draw.ends))
                      for name, (group, draw) in builder.draws.items()}
            self._check_sampling(builder, reader, len(varied))
            if builder.draws_refused:
                return None
            if not varied:
                report.add(reader.place, f"&ensemble {self.name!r} has nothing to draw: expected "
                                         "&draw groups, or a table")
        for name in varied:
            if name in reader.places:
                how = "listed in the table" if table else "drawn"
                report.add(reader.key_places[name], f"{name} is given, but {how} as well; expected "
                                                    "one of the two")
        if not builder.ready or not varied or report.refusals:
            return None
        operation = {k: v for k, v in own.items() if k not in varied}
        builder.check_ends(reader, varied, operation)
        return Asked("ensemble", self, operation, builder.rtol(reader), {
            "draws": {} if table else {name: draw for name, (_, draw) in builder.draws.items()},
            "points": {name: values for name, (_, values) in table.items()} if table else {},
            "digest": digest})

    def _check_sampling(self, builder: Studies, reader: _GroupReader, count: int) -> None:
        """What does not go together in how draws are made."""
        report, places = builder.report, reader.places
        if self.sampling == "random" and "scrambles" in places and self.sensitivity_draws is None:
            report.add(reader.key_places["scrambles"], "scrambles does not go with sampling = "
                                                       "'random', whose draws are independent")
        for problem in sampling_problems(self.sampling, self.runs, self.scrambles,
                                         self.sensitivity_draws):
            report.add(places.get(problem.split(" ")[0], reader.place), problem)
        if self.sensitivity_draws and \
                self.scrambles * (count + 2) * self.sensitivity_draws > MOST_RUNS:
            report.add(places["sensitivity_draws"], f"sensitivity_draws = {self.sensitivity_draws} "
                       f"makes more than {MOST_RUNS} runs, expected fewer")
        if self.correlation is None:
            return
        if self.sensitivity_draws is not None:
            report.add(reader.key_places["sensitivity_draws"], "sensitivity_draws does not go with "
                       "correlation: Sobol's sensitivities are of independent parameters")
        if builder.draws_refused or not count:
            return
        problem = f"{len(self.correlation)} numbers, expected {count} × {count}, row by row in " \
            "the order of the &draw groups"
        if len(self.correlation) == count**2:
            problem = correlation_problem(
                np.array(self.correlation, dtype=float).reshape(count, count), count)
        if problem:
            report.add(places["correlation"], f"correlation: {problem}")

    def used(self, asked: Asked) -> dict[str, Any]:
        """See `StudyKeys`: what a table or random draws have no use for is left out."""
        none = _OF_DRAWS if self.table is not None else \
            ("scrambles",) * (self.sampling == "random" and self.sensitivity_draws is None)
        return super().used(asked) | dict.fromkeys(none)

    def canonical(self, values: dict[str, Any], asked: Asked) -> dict[str, Any]:
        """See `StudyKeys`: a table by its numbers; how the work is cut decides nothing."""
        values = {name: value for name, value in values.items()
                  if name not in ("table", "shard_runs")}
        return values | ({"table": asked.digest} if self.table is not None else {})

    def memory(self, asked: Asked) -> tuple[int, str]:
        """See `StudyKeys`: of all runs, and the values of each."""
        keys = "runs or sensitivity_draws" if asked.draws else "the rows of the table"
        width = 8 * len(asked.draws or asked.points)
        return (estimates.MAP_RUN + width) * all_runs(asked), keys

    def disk(self, asked: Asked) -> tuple[int, int]:
        """See `StudyKeys`."""
        return estimates.MAP_RUN * all_runs(asked), 1


def all_runs(asked: Asked) -> int:
    """Runs of an ensemble, those for sensitivities included."""
    if asked.points:
        return len(next(iter(asked.points.values())))
    more = asked.scrambles * (len(asked.draws) + 2) * (asked.sensitivity_draws or 0)
    return int(asked.runs + more)
