"""The findings of a run in a few sentences: what an engineer asks first, and how sure it is.

At which braking torque do back impacts vanish, at which does separation vanish, and what happens
in between?  Each sentence says what it rests on; none is told without it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base.arrivals import arrivals_in
from lapwing.base.codes import Status
from lapwing.base.messages import at_least, at_most
from lapwing.report.answers import between
from lapwing.report.answers.besides import besides
from lapwing.report.answers.evidence import failures, looks, together
from lapwing.report.answers.source import against_source
from lapwing.report.attractors import along
from lapwing.report.attractors import basins as attractor_basins
from lapwing.report.attractors.words import choice as attractors_choice
from lapwing.report.branches import findings as branches_findings
from lapwing.report.critical import REASONS
from lapwing.report.ensemble.findings import findings as ensemble_findings
from lapwing.report.map.findings import findings as map_findings
from lapwing.report.measured import has_interval, noise_findings
from lapwing.report.words import bands, parameter_unit, plural
from lapwing.results.findings import START_NAMES, SYMBOLS, names, search_bounded

if TYPE_CHECKING:
    import xarray as xr

HEADING = "## Findings"
# What to add to a deck, in its own words.
SEARCH = "&critical, find = 'safe'"
# What the symbols mean, in the order of what to rely on.
TERMS = {"safe": "above it none of the motions tried rattles",
         "full": "from it on the engaged motion keeps contact, others may rattle",
         "on": "from it on a rigid tooth that rests stays, others may bounce",
         "back": "back impacts were last seen there"}


def findings(responses: Any, criticals: Any, sweeps: Any, missing: Any = (),
             maps: Any = (), ensembles: Any = (), diagrams: Any = (),
             basins: Any = (), lines: Any = ()) -> list[str]:
    """What a run found, the most important first.

    Parameters
    ----------
    responses, criticals, sweeps, maps, ensembles, diagrams, basins, lines (of attractors) :
        sequences of Dataset, each with its name as an attribute
    missing : sequence of (kind, name), studies of the deck without a result

    Returns
    -------
    list of str, each a sentence or two in Markdown
    """
    stopped = _stopped([*sweeps, *maps, *ensembles, *basins], missing)
    torque = _Torque(responses, criticals, sweeps)
    said = torque.sentences()
    if not said:
        said = attractors_choice([*along.rattling_torques(lines),
                                  *attractor_basins.rattling_torques(basins)])
    answers = [*said,
               *(sentence for one in diagrams for sentence in branches_findings(one)),
               *noise_findings(criticals), *besides(criticals, sweeps),
               *(sentence for one in maps for sentence in map_findings(one)),
               *ensemble_findings(list(ensembles)),
               *(sentence for one in basins for sentence in attractor_basins.findings(one)),
               *(sentence for one in lines for sentence in along.findings(one))]
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


def _stopped(sweeps: Any, missing: Any) -> list[str]:
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
    return ["**The run was stopped before its end**: " + "; ".join(parts) + ". What follows rests "
            "on the rest."] if parts else []


class _Torque:
    """What is known along the braking torque at the deck's own speed."""

    unit = parameter_unit("brake_torque")

    def __init__(self, responses: Any, criticals: Any, sweeps: Any) -> None:
        self.responses = [one for one in responses if not int(one.attrs.get("own_operation", 0))]
        self.criticals = [one for one in criticals if one.attrs["parameter"] == "brake_torque"
                          and not int(one.attrs.get("own_operation", 0))]
        self.sweeps = [one for one in sweeps if one["status"].dims[1] == "brake_torque"]
        self.looks = looks(responses, criticals, sweeps)
        self.coast = looks(responses, criticals, sweeps, flank="coast")
        self.rattling, self.back = (together(self.looks, what) for what in ("rattling", "back"))
        self.kept = self._kept()
        studies = [*self.responses, *self.sweeps, *self.criticals]
        # Files of older versions have these attributes in some studies only.
        self.laws = {key: one.attrs[key] for one in reversed(studies) for key in
                     ("contact_law", "impact_law", "gap", "balanced") if key in one.attrs}
        self.law = arrivals_in(self.laws)

    def sentences(self) -> list[str]:
        """What to choose, and what that rests on; back impacts, in between, the source."""
        last = self.rattling.last
        return [sentence for sentence in (
            self._choice_sentence(), self._separation_sentence(), self._kept_sentence(),
            self._back_sentence(), self._between_sentence(), self._coast_sentence(),
            against_source(self.responses, last, "" if last is None else self._last_rattling()))
            if sentence]

    def failures(self) -> list[str]:
        """What is not covered, where anything else is known."""
        lost = failures([*self.looks, *self.coast])
        return [f"**{plural(lost, 'motion')} failed numerically**: what they would have shown is "
                "not covered."] if lost else []

    def _at(self, values: NDArray[Any], what: str = "looked at") -> str:
        """Such values in words: 'at 12 N·m', 'at the 5 torques looked at, 12 to 14 N·m'."""
        if len(values) == 1:
            return f"at {values[0]:g} {self.unit}, the only torque {what}"
        return f"at the {len(values)} torques {what}, {values[0]:g} to {values[-1]:g} {self.unit}"

    def _back_sentence(self) -> str:
        seen, word = self.back, f"back {self.law.word}"
        if not seen.values.size or self.laws.get("gap") == "one_flank":
            return ""
        if seen.last is None:
            return (f"**No {word}s** were seen {self._at(seen.values)}, in "
                    f"{_cycles(seen.cycles.sum())}{self._rate(None)}.")
        head = f"**{word.capitalize()}s** were last seen at {seen.last:g} {self.unit}"
        above = seen.above(seen.last)
        if not above.values.size:
            return f"{head}, the highest torque with a result: where they end is not known."
        below = seen.where(seen.values < seen.last)
        bands = ""
        if below.values.size and not below.seen.all():
            bands = (f" It is no sharp threshold: at {int((~below.seen).sum())} of the "
                     f"{plural(below.values.size, 'torque')} looked at below it there were none "
                     "either.")
        return (f"{head}: none {self._at(above.values, 'looked at above it')}, in "
                f"{_cycles(above.cycles.sum())}{self._rate(seen.last)}.{bands}")

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
                        f"{1 / bound:,.0f} mesh cycles ({100 * one.attrs['confidence']:g} % "
                        "confidence)")
        return ""

    def _search(self) -> xr.Dataset | None:
        """A search for T_safe, or None."""
        return next((one for one in self.criticals if one.attrs["find"] == "safe"
                     and one.attrs.get("safe_end") == "high"), None)

    def _quiet(self) -> tuple[NDArray[Any], str]:
        """Values above the last rattling at which nothing rattles and nothing failed.

        Returns
        -------
        array of values, how they were looked at in words

        Those of a search for T_safe where there is one: it tries more starts.
        """
        above = self.rattling.above(self.rattling.last)
        quiet, search = above.values[~above.failed], self._search()
        if search is not None:
            tried = quiet[np.isin(quiet, search["trial_value"].values)]
            if tried.size:
                attrs = search.attrs
                return tried, (f"each from rest and {plural(attrs['n_starts'] - 1, 'other start')},"
                               f" followed for {attrs['settle'] + attrs['record']} mesh cycles")
        return quiet, self._how(quiet)

    def _how(self, values: NDArray[Any]) -> str:
        """From which starts the motions at all of some values came, or that it is not the same."""
        from_ = {one.how: set(one.values[one.motions > 0]) for one in self.looks
                 if one.rattling is not None}
        every = [how for how in from_ if how in START_NAMES and set(values) <= from_[how]]
        if every:
            return names(every)
        return "by the responses alone" if set(from_) == {"response"} \
            else "not from the same starts at each"

    def _last_rattling(self) -> str:
        """The greatest torque with rattling, to the digits that the step to a quiet one leaves."""
        quiet, last = self._quiet()[0], self.rattling.last
        assert last is not None  # asked for where something rattles
        return at_most(last, quiet[0] - last if quiet.size else 0.0)

    def _separation_sentence(self) -> str:
        seen = self.rattling
        if not seen.values.size or (seen.values.size == 1 and between.of_responses(self.responses)):
            return ""
        quiet, how = self._quiet()
        if seen.last is None:
            return f"**The teeth were not seen to part** {self._at(quiet)} ({how})." if quiet.size \
                else ""
        if not quiet.size:
            beyond = seen.above(seen.last).values.size
            return (f"**The teeth part** at torques up to {seen.last:g} {self.unit}, "
                    + ("and above it motions failed numerically" if beyond else
                       "the highest with a result")
                    + ": where separation ends is not known.")
        return (f"**Separation** was seen up to {self._last_rattling()} {self.unit}, and none "
                f"{self._at(quiet, 'looked at above it')} ({how}).")

    def _kept(self) -> tuple[str, str, float] | None:
        """(find, outcome, value) of T_full or T_on, or None."""
        for one in self.criticals:
            if one.attrs["find"] in ("full", "on"):
                attrs = one.attrs
                return attrs["find"], attrs["outcome"], float(attrs.get("estimate", math.nan))
        for one in (*self.sweeps, *self.responses):
            if math.isfinite(one.attrs.get("full_engagement", math.nan)):
                return "full", "found", float(one.attrs["full_engagement"])
        return None

    def _kept_sentence(self) -> str:
        if self.kept is None:
            return ""
        find, outcome, value = self.kept
        what, others = ("contact can be kept", "need not be") if find == "full" else \
            ("a resting rigid tooth stays", "others may bounce")
        if outcome != "found":
            why = REASONS.get(outcome, "the engaged motion grows without end (undamped resonance)")
            return f"**{what.capitalize()} at no torque**: {why}."
        head = f"**From {at_least(value)} {self.unit} {what}"
        how = f"** ({SYMBOLS[find]}, in closed form for this transmission error and speed)"
        beyond = self.rattling.above(value)
        if not beyond.values.size:
            return f"{head}{how}; what else may move above it was not looked at."
        if beyond.seen.any():
            return (f"{head}, but {others}{how}: from there to {self._last_rattling()} "
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

    def _choice_sentence(self) -> str:
        """The least torque to choose, what would change it, and what the symbols mean."""
        seen = self.rattling
        value = self.kept[2] if self.kept and self.kept[1] == "found" else math.nan
        quiet = self._quiet()[0] if seen.values.size else np.zeros(0)
        quiet = quiet[~(quiet < value)]
        if not quiet.size:
            if not math.isfinite(value):
                return "**Which torque to choose is not answered**: look at higher ones." \
                    if seen.values.size else ""
            least = value if seen.last is None else max(value, seen.last)
            return (f"**Choose more than {at_least(least)} {self.unit}; how much more is not "
                    f"known**: a search for T_safe ({SEARCH}) that begins above it would say."
                    + self._terms())
        step = quiet[0] - seen.last if seen.last is not None else 0.0
        least = max(quiet[0], value) if math.isfinite(value) else quiet[0]
        search = self._search()
        label = "" if search is None else " (T_safe)" if seen.last is not None \
            else ", the lowest torque searched,"
        noise = self._noise(search)
        if noise > least:
            least, step, label = noise, 0.0, label + " to allow for the noise of the samples,"
        doubts = ["a start that was not tried", "a longer look"]
        if self.laws.get("contact_law") == "restitution" and "impact_law" in self.laws:
            doubts.append(f"another impact law than `{self.laws['impact_law']}`")
        doubt = ", ".join(doubts[:-1]) + f" or {doubts[-1]}"
        few = "" if search is not None else \
            f" Few starts were tried: a search for T_safe ({SEARCH}) tries more."
        return (f"**Choose at least {at_least(least, step)} {self.unit}**{label} and a margin"
                f"{self._margin(least, step)}; {doubt} may move it.{few}{self._terms()}")

    def _noise(self, search: xr.Dataset | None) -> float:
        """Upper end of what the noise of samples leaves of T_safe, else of T_full; NaN: none."""
        some = [one.attrs for one in self.criticals if one.attrs["find"] in ("full", "on")] \
            if search is None else [search.attrs]
        return max((one["high"] for one in some if has_interval(one)), default=math.nan)

    def _margin(self, least: float, step: float) -> str:
        """What more transmission error asks for.

        Where torques balance and no motion comes to the coast flank, nothing but the transmission
        error has a scale: all motions, and the torque, grow in proportion to it.
        """
        last, back = self.rattling.last, self.back
        if not self.laws.get("balanced", 0) or least <= 0 or last is None:
            return ""
        if back.values.size and (back.last is None or back.last < last):
            return (": with 10 % more transmission error it would be "
                    f"{at_least(1.1 * least, step)} {self.unit}")
        return (": it grows in proportion to the transmission error, as long as no motion comes to "
                "the coast flanks")

    def _terms(self) -> str:
        """What the symbols in findings and figures mean, together."""
        finds = {one.attrs["find"] for one in self.criticals
                 if one.attrs["outcome"] == "found" and search_bounded(one)}
        if self.kept and self.kept[1] == "found":
            finds.add(self.kept[0])
        words = [f"{SYMBOLS[find]}: {term}" for find, term in TERMS.items() if find in finds]
        return f" ({'; '.join(words)}.)" if words else ""

    def _coast_sentence(self) -> str:
        seen = together(self.coast, "rattling")
        if not seen.values.size:
            return ""
        head = f"**Where the torque presses on the coast flanks** ({self._at(seen.values)})"
        if not seen.seen.any():
            return f"{head} they never part."
        if seen.seen.all():
            return f"{head} they part at every torque looked at."
        return (f"{head} they part at {bands(seen.values, seen.seen)} {self.unit}, not at "
                f"{bands(seen.values, ~seen.seen)} {self.unit}.")


def _cycles(number: int) -> str:
    return f"{number:,} mesh cycle" + "s" * bool(number != 1)

