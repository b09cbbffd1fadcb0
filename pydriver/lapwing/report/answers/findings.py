"""The findings of a run in a few sentences: what an engineer asks first, and how sure it is.

At which braking torque do back impacts vanish, at which does separation vanish, and what happens
in between?  Each sentence says what it rests on; none is told without it.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from lapwing.base.codes import Status
from lapwing.base.messages import at_least
from lapwing.report.answers import between
from lapwing.report.answers.besides import besides
from lapwing.report.answers.choice import TERMS, choice, unanswered
from lapwing.report.answers.conditions import UNKNOWN, Conditions
from lapwing.report.answers.drift import drifts
from lapwing.report.answers.evidence import Seen, failures, together
from lapwing.report.answers.source import against_source
from lapwing.report.answers.torque import Torque
from lapwing.report.attractors import along
from lapwing.report.attractors import basins as attractor_basins
from lapwing.report.attractors.words import choice as attractors_choice
from lapwing.report.branches import findings as branches_findings
from lapwing.report.critical import REASONS
from lapwing.report.ensemble.findings import findings as ensemble_findings
from lapwing.report.map.findings import findings as map_findings
from lapwing.report.measured import noise_findings
from lapwing.report.words import bands, plural
from lapwing.results.findings import SYMBOLS

HEADING = "## Findings"


def findings(responses: Any, criticals: Any, sweeps: Any, missing: Any = (),
             maps: Any = (), ensembles: Any = (), diagrams: Any = (),
             basins: Any = (), lines: Any = (), *,
             conditions: Conditions = UNKNOWN) -> list[str]:
    """What a run found, the most important first.

    Parameters
    ----------
    responses, criticals, sweeps, maps, ensembles, diagrams, basins, lines (of attractors) :
        sequences of Dataset, each with its name as an attribute
    missing : sequence of (kind, name), studies of the deck without a result
    conditions : Conditions, what the deck gives to all studies

    Returns
    -------
    list of str, each a sentence or two in Markdown
    """
    stopped = _stopped([*sweeps, *maps, *ensembles, *basins], lines, missing)
    torque = _Told(responses, criticals, sweeps, conditions, diagrams)
    said, drifting = torque.sentences(), drifts(responses)
    chosen = bool(said) and not unanswered(torque)
    # Where no torque was searched what was looked at comes first.
    answers = [*(drifting if unanswered(torque) else []), *said,
               *([] if unanswered(torque) else drifting),
               *(sentence for one in diagrams for sentence in branches_findings(one)),
               *noise_findings(criticals), *besides(criticals, sweeps),
               *(sentence for one in maps for sentence in map_findings(one, chosen)),
               *ensemble_findings(list(ensembles)),
               *(sentence for one in lines for sentence in along.findings(one)),
               *(sentence for one in basins for sentence in attractor_basins.findings(one))]
    if not said:
        answers += attractors_choice(
            [*(torque for one in lines if not along.quiet_values(one).size
               for torque in along.rattling_torques([one])),
             *attractor_basins.rattling_torques(basins)])
    if not answers:
        return [*stopped, "**Nothing is known**: no run has a result."]
    return [*stopped, *answers, *torque.failures()]


def findings_lines(found: list[str]) -> list[str]:
    """The section of the summary: heading and list."""
    # No empty line: they stand within the first ten of the summary.
    return [HEADING, *(f"- {sentence}" for sentence in found)]


def findings_in(summary: str) -> tuple[str, ...]:
    """The sentences of the findings of a summary, as `findings` gave them; none where it has none.

    Parameters
    ----------
    summary : str

    Returns
    -------
    tuple of str
    """
    _, _, rest = summary.partition(f"\n{HEADING}\n")
    # Summaries of before have an empty line below the heading.
    return tuple(line.removeprefix("- ")
                 for line in rest.removeprefix("\n").partition("\n\n")[0].splitlines())


def on_console(found: Any, width: int = 100) -> str:
    """The sentences without Markdown, wrapped, as one text."""
    import textwrap

    plain = (sentence.replace("**", "").replace("`", "") for sentence in found)
    return "\n".join(textwrap.fill(
        sentence, width, initial_indent="  - ", subsequent_indent="    ",
        break_long_words=False, break_on_hyphens=False) for sentence in plain)


def _stopped(sweeps: Any, lines: Any, missing: Any) -> list[str]:
    """What the deck asked for and did not get."""
    parts = [f"{kind} `{name}` has no result" for kind, name in missing]
    for sweep in sweeps:
        open_ = int((sweep["status"].values == Status.UNFINISHED).sum())
        if open_:
            kind, each = ("basins", "cells") if "plane" in sweep.attrs else \
                ("map", "runs") if "x_parameter" in sweep.attrs else \
                ("ensemble", "runs") if "sampling" in sweep.attrs else ("sweep", "points")
            parts.append(f"{kind} `{sweep.attrs.get('name', '')}` lacks {open_} of "
                         f"{sweep['status'].size} {each}")
    for line in lines:
        reached = line["reached"].values == 1
        if not reached.all():
            parts.append(f"attractors `{line.attrs.get('name', '')}` lacks {(~reached).sum()} of "
                         f"{reached.size} values")
    return ["**The run was stopped before its end**: " + "; ".join(parts) + ". What follows rests "
            "on the rest."] if parts else []


class _Told(Torque):
    """Sentences of what is known along the braking torque."""

    def sentences(self) -> list[str]:
        """What to choose, and what that rests on; back impacts, in between, the source."""
        last = self.rattling.last
        return [sentence for sentence in (
            choice(self), self._separation_sentence(), self._kept_sentence(),
            self._back_sentence(), self._between_sentence(), self._coast_sentence(),
            against_source(self.responses, last, "" if last is None else self.last_rattling()))
            if sentence]

    def failures(self) -> list[str]:
        """What is not covered, where anything else is known."""
        lost = failures([*self.looks, *self.coast])
        return [f"**{plural(lost, 'motion')} failed numerically**: what "
                f"{'they' if lost > 1 else 'it'} would have shown is not covered."] if lost else []

    def _back_sentence(self) -> str:
        seen, word = self.back, f"back {self.law.word}"
        if not seen.values.size or self.laws.get("gap") == "one_flank":
            return ""
        if seen.last is None:
            return (f"**No {word}s** were seen {self.at(seen.values)}, in "
                    f"{_cycles(seen.cycles.sum())}{self._rate(None)}.")
        head = f"**{word.capitalize()}s** were last seen at {seen.last:g} {self.unit}" \
            + " (T_back)" * any(one.attrs["find"] == "back" and one.attrs["outcome"] == "found"
                                for one in self.criticals)
        above = seen.above(seen.last)
        if not above.values.size:
            return f"{head}, the highest torque with a result: where they end is not known."
        return (f"{head}: none {self.at(above.values, 'looked at above it')}, in "
                f"{_cycles(above.cycles.sum())}{self._rate(seen.last)}."
                + self._no_threshold(seen.where(seen.values < seen.last)))

    def _no_threshold(self, below: Seen) -> str:
        """At how many torques below the last back impact none, or not every start, has one."""
        without = np.concatenate([one.values[(one.motions > 0) & ~one.back] for one in self.looks
                                  if one.back is not None])
        none = int((~below.seen).sum())
        some = int((below.seen & np.isin(below.values, without)).sum())
        of = f" of the {plural(below.values.size, 'torque')} looked at below it"
        told = [f"at {none}{of} none was seen either"] if none else []
        told += [f"at {some}{' more' if none else of} not from every start"] if some else []
        return f" It is no sharp threshold: {', '.join(told)}." if told else ""

    def _rate(self, last: float | None) -> str:
        """The limit of the rate of back impacts beyond the last one, where one is known."""
        for one in self.criticals:
            if "trial_rate_bound" not in one or one.attrs.get("safe_end") != "high":
                continue
            value = one["trial_value"].values
            rows = one["trial_cycles"].values > 0
            rows &= value > (-math.inf if last is None else last)
            bound = one["trial_rate_bound"].values[rows].max(initial=0)
            if rows.any() and 0 < bound < math.inf:
                some = np.sort(value[rows])
                where = f"from {some[0]:g} to {some[-1]:g} {self.unit}" if some.size > 1 \
                    else f"at {some[0]:g} {self.unit}"
                return (f"; {where} they come, if at all, less often than once in "
                        f"{1 / bound:,.0f} mesh cycles{self.conditions.time(1 / bound)}, with "
                        f"{100 * one.attrs['confidence']:g} % confidence")
        return ""

    def _separation_sentence(self) -> str:
        seen = self.rattling
        if not seen.values.size or (seen.values.size == 1 and between.of_responses(self.responses)):
            return ""
        quiet, how = self.quiet()
        if seen.last is None:
            return f"**The teeth were not seen to part** {self.at(quiet)} ({how})." if quiet.size \
                else ""
        if not quiet.size:
            beyond = seen.above(seen.last).values.size
            return (f"**The teeth part** at torques up to {seen.last:g} {self.unit}, "
                    + ("and above it motions failed numerically" if beyond else
                       "the highest with a result")
                    + ": where separation ends is not known.")
        return (f"**Separation** was seen up to {self.last_rattling()} {self.unit}, and none "
                f"{self.at(quiet, 'looked at above it')} ({how}).")

    def _kept_sentence(self) -> str:
        # What is said of it where no torque was searched says this, too.
        if self.kept is None or (self.kept[1] == "found" and unanswered(self)
                                 and not self.quiet()[0].size):
            return ""
        find, outcome, value = self.kept
        what, others = ("contact can be kept", "need not be") if find == "full" else \
            ("a resting rigid tooth stays", "others may bounce")
        if outcome != "found":
            why = REASONS.get(outcome, "the engaged motion grows without end (undamped resonance)")
            return f"**{what.capitalize()} at no torque**: {why}."
        head = f"**From {at_least(value)} {self.unit} {what}"
        how = (f"** ({SYMBOLS[find]}, in closed form for this transmission error and speed: "
               f"{TERMS[find]})")
        beyond = self.rattling.above(value)
        if not beyond.values.size:
            return f"{head}{how}; what else may move above it was not looked at."
        if beyond.seen.any():
            return (f"{head}, but {others}{how}: from there to {self.last_rattling()} "
                    f"{self.unit} rattling was seen as well, and the start decides.")
        return f"{head}{how}; no other motion was seen above it" \
            + ", but some failed numerically" * bool(beyond.failed.any()) + "."

    def _between_sentence(self) -> str:
        """What happens between the last back impact and the last separation."""
        high = self.rattling.last
        if high is None:
            return ""
        return next(filter(None, (between.of_sweep(sweep, self.back.last, high)
                                  for sweep in self.sweeps)), between.of_responses(self.responses))

    def _coast_sentence(self) -> str:
        seen = together(self.coast, "rattling")
        if not seen.values.size:
            return ""
        head = f"**Where the torque presses on the coast flanks** ({self.at(seen.values)})"
        if not seen.seen.any():
            return f"{head} they never part."
        if seen.seen.all():
            return f"{head} they part at every torque looked at."
        return (f"{head} they part at {bands(seen.values, seen.seen)} {self.unit}, not at "
                f"{bands(seen.values, ~seen.seen)} {self.unit}.")


def _cycles(number: int) -> str:
    return f"{number:,} mesh cycle" + "s" * bool(number != 1)

