"""The findings of a run in a few sentences: what an engineer asks first, and how sure it is.

At which braking torque do back impacts vanish, at which does separation vanish, and what happens
in between?  Each sentence says what it rests on; none is told without it.
"""

from __future__ import annotations

import math

import numpy as np

from lapwing.arrivals import arrivals_in, per_cycle
from lapwing.codes import Status
from lapwing.findings import START_NAMES, known, names, rattles
from lapwing.report.critical import REASONS, headline
from lapwing.report.evidence import failures, looks, together
from lapwing.report.words import UNITS, parameter_words, plural

HEADING = "## Findings"
# Digits told of a number that is not known to end earlier, and bands and responses told one by one.
DIGITS, MOST = 4, 4


def findings(responses, criticals, sweeps, missing=()):
    """What a run found, the most important first.

    Parameters
    ----------
    responses, criticals, sweeps : sequences of Dataset, each with its name as an attribute
    missing : sequence of (kind, name), studies of the deck without a result

    Returns
    -------
    list of str, each a sentence or two in Markdown
    """
    stopped = _stopped(sweeps, missing)
    known_ = [*_Torque(responses, criticals, sweeps).sentences(), *_besides(criticals, sweeps)]
    return stopped + (known_ or ["**Nothing is known**: no run has a result."])


def findings_lines(found):
    """The section of the summary: heading and list."""
    return [HEADING, "", *(f"- {sentence}" for sentence in found)]


def told_in(summary):
    """The sentences of the findings of a summary, as `findings` gave them; none where it has none.

    Parameters
    ----------
    summary : str

    Returns
    -------
    tuple of str
    """
    _, _, rest = summary.partition(f"\n{HEADING}\n\n")
    return tuple(line.removeprefix("- ") for line in rest.partition("\n\n")[0].splitlines())


def on_console(found, width=100):
    """The sentences without Markdown, wrapped, as one text."""
    import textwrap

    plain = (sentence.replace("**", "").replace("`", "'") for sentence in found)
    return "\n".join(textwrap.fill(
        sentence, width, initial_indent="  - ", subsequent_indent="    ",
        break_long_words=False, break_on_hyphens=False) for sentence in plain)


def at_least(value, step=0.0):
    """A lower limit in words, rounded up: to four digits, or to what a bracket leaves."""
    return _rounded(value, math.ceil, step)


def at_most(value, step=0.0):
    """An upper limit in words, rounded down likewise."""
    return _rounded(value, math.floor, step)


def _rounded(value, towards, step):
    if value == 0 or not math.isfinite(value):
        return f"{value:g}"
    places = DIGITS - 1 - math.floor(math.log10(abs(value)))
    if step > 0:
        places = math.ceil(-math.log10(step) - 1e-9)
    unit = 10.0 ** -places
    # What is a multiple of the unit but for rounding stays.
    whole = round(value / unit) if abs(value / unit - round(value / unit)) < 1e-6 \
        else towards(value / unit)
    return f"{whole * unit:.{max(places, 0)}f}" if places > 0 else f"{whole * unit:.10g}"


def _stopped(sweeps, missing):
    """What the deck asked for and did not get."""
    parts = [f"{kind} `{name}` has no result" for kind, name in missing]
    for sweep in sweeps:
        open_ = int((sweep["status"].values == Status.UNFINISHED).sum())
        if open_:
            parts.append(f"sweep `{sweep.attrs.get('name', '')}` lacks {open_} of "
                         f"{sweep['status'].size} points")
    return ["**The run was stopped before its end**: " + "; ".join(parts) + ". What follows rests "
            "on the rest."] if parts else []


class _Torque:
    """What is known along the braking torque at the deck's own speed."""

    unit = UNITS["brake_torque"]

    def __init__(self, responses, criticals, sweeps):
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

    def sentences(self):
        """Back impacts, separation, contact, in between, what to choose."""
        return [sentence for sentence in (
            self._back_sentence(), self._separation_sentence(), self._kept_sentence(),
            self._between_sentence(), self._choice_sentence(), self._coast_sentence()) if sentence]

    def _at(self, values, what="looked at"):
        """Such values in words: 'at 12 N·m', 'at the 5 torques looked at, 12 to 14 N·m'."""
        if len(values) == 1:
            return f"at {values[0]:g} {self.unit}, the only torque {what}"
        return f"at the {len(values)} torques {what}, {values[0]:g} to {values[-1]:g} {self.unit}"

    def _back_sentence(self):
        seen, word = self.back, f"back {self.law.word}"
        if not seen.values.size or self.laws.get("gap") == "one_flank":
            return ""
        if seen.last is None:
            return (f"**No {word}s** were seen {self._at(seen.values)}, in "
                    f"{seen.cycles.sum():,} mesh cycles{self._rate(None)}.")
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
                f"{above.cycles.sum():,} mesh cycles{self._rate(seen.last)}.{bands}")

    def _rate(self, last):
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
                return (f" ({where}, with {100 * one.attrs['confidence']:g} % confidence, fewer "
                        f"than one burst of them begins in {1 / bound:,.0f} mesh cycles)")
        return ""

    def _search(self):
        """A search for T_safe, or None."""
        return next((one for one in self.criticals if one.attrs["find"] == "safe"
                     and one.attrs.get("safe_end") == "high"), None)

    def _quiet(self):
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
        starts = [str(start) for sweep in self.sweeps for start in sweep["start"].values]
        words = names(dict.fromkeys(starts)) if starts else "by the responses alone"
        return quiet, words

    def _last_rattling(self):
        """The greatest torque with rattling, to the digits that the step to a quiet one leaves."""
        quiet = self._quiet()[0]
        return at_most(self.rattling.last, quiet[0] - self.rattling.last if quiet.size else 0.0)

    def _separation_sentence(self):
        seen = self.rattling
        if not seen.values.size or (seen.values.size == 1 and self._of_responses()):
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

    def _kept(self):
        """(find, outcome, value, phase) of T_full or T_on, or None."""
        for one in self.criticals:
            if one.attrs["find"] in ("full", "on"):
                attrs = one.attrs
                return attrs["find"], attrs["outcome"], float(attrs.get("estimate", math.nan))
        for one in (*self.sweeps, *self.responses):
            if math.isfinite(one.attrs.get("full_engagement", math.nan)):
                return "full", "found", float(one.attrs["full_engagement"])
        return None

    def _kept_sentence(self):
        if self.kept is None:
            return ""
        find, outcome, value = self.kept
        what = "Contact can be kept" if find == "full" else "A resting rigid tooth stays"
        if outcome != "found":
            why = REASONS.get(outcome, "the engaged motion grows without end (undamped resonance)")
            return f"**{what} at no torque**: {why}."
        symbol = "T_full" if find == "full" else "T_on"
        head = (f"**{what} from {at_least(value)} {self.unit}** ({symbol}, in closed form for this "
                "transmission error and speed)")
        beyond = self.rattling.above(value)
        if not beyond.values.size:
            return f"{head}; what else may move there was not looked at."
        if beyond.seen.any():
            return (f"{head}, but from there to {self._last_rattling()} {self.unit} rattling was "
                    "seen as well: the start decides.")
        return f"{head}; no other motion was seen above it."

    def _between_sentence(self):
        """What happens between the last back impact and the last separation."""
        high, low = self.rattling.last, self.back.last
        if high is None:
            return ""
        for sweep in self.sweeps:
            found = self._between_in(sweep, low, high)
            if found:
                return found
        return self._of_responses()

    def _between_in(self, sweep, low, high):
        values = sweep["brake_torque"].values
        starts = [str(start) for start in sweep["start"].values]
        branch = sweep.isel(start=starts.index("rest") if "rest" in starts else 0)
        start = str(branch["start"].values)
        rows = known(branch) & rattles(branch) & (values <= high) & (branch["force"].values > 0)
        rows &= values > (-math.inf if low is None or low >= high else low)
        at = np.flatnonzero(rows)
        if not at.size:
            return ""
        counts, wild = per_cycle(branch), branch["period"].values[at] == 0
        depth = 1e6 * branch["deepest_separation"].max("recorded_cycle").values
        head = "**In between**" if low is not None and low < high else \
            "**Where the teeth part**"
        # The first, the one with most impacts, the last.
        shown = np.unique([at[0], at[np.argmax(counts[at])], at[-1]])
        text = f"{head}, {START_NAMES.get(start, start)}: " + "; ".join(
            f"at {values[i]:g} {self.unit} {_count(counts[i], self.law.word)} per mesh cycle, "
            f"{depth[i]:.4g} µrad of separation" for i in shown)
        if not wild.any():
            return text + "; every motion has a period."
        return text + (f"; no period at {wild.sum()} of {plural(at.size, 'torque')}, the highest "
                       f"{values[at[wild][-1]]:g} {self.unit}.")

    def _of_responses(self):
        """The responses that part, one by one."""
        there = [one.attrs for one in self.responses if not one.attrs["status"]
                 and not one.attrs["fully_engaged"] and one.attrs["force"] > 0]
        there = sorted(there, key=lambda one: one["brake_torque"])
        if not there:
            return ""
        parts = []
        for one in there[:MOST]:
            period = one["period"]
            motion = f"period {period}" if period else "no period"
            parts.append(f"at {one['brake_torque']:g} {self.unit} "
                         f"{_count(one['impacts_per_cycle'], self.law.word)} per mesh cycle, "
                         f"{1e6 * one['deepest_separation']:.4g} µrad of separation ({motion})")
        more = f"; {len(there) - MOST} more below" * (len(there) > MOST)
        return f"**Where the teeth part**: {'; '.join(parts)}{more}."

    def _choice_sentence(self):
        """The least torque to choose, and what would change it."""
        seen = self.rattling
        value = self.kept[2] if self.kept and self.kept[1] == "found" else math.nan
        lost = failures(self.looks)
        failed = f" {plural(lost, 'motion')} failed numerically and are not covered." \
            if lost else ""
        quiet = self._quiet()[0] if seen.values.size else np.zeros(0)
        quiet = quiet[~(quiet < value)]
        if not quiet.size:
            if not math.isfinite(value):
                return "**Which torque to choose is not answered**: look at higher ones." + failed \
                    if seen.values.size else failed.strip()
            return (f"**So choose more than {at_least(value)} {self.unit}**, but how much more is "
                    "not answered: a search for T_safe (`&critical`, `find = 'safe'`) that begins "
                    "above it would say." + failed)
        step = quiet[0] - seen.last if seen.last is not None else 0.0
        least = max(quiet[0], value) if math.isfinite(value) else quiet[0]
        search = self._search() is not None
        head = f"**So choose at least {at_least(least, step)} {self.unit}**" \
            + " (T_safe)" * search + ", and a margin"
        margin = ""
        if math.isfinite(value) and value > 0 and self.laws.get("balanced", 0):
            margin = (f": 10 % more transmission error raises T_full to {at_least(1.1 * value)} "
                      f"{self.unit}") if self.kept[0] == "full" else ""
        doubts = ["a start that was not tried", "a longer look"]
        if self.laws.get("contact_law") == "restitution" and "impact_law" in self.laws:
            doubts.append(f"another impact law than `{self.laws['impact_law']}`")
        doubt = ", ".join(doubts[:-1]) + f" or {doubts[-1]}"
        few = "" if search else (" Few starts were tried: a search for T_safe (`&critical`, "
                                 "`find = 'safe'`) tries more.")
        return f"{head}{margin}; {doubt} may move it.{few}{failed}"

    def _coast_sentence(self):
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


def _count(number, word):
    """A number of impacts to three digits, in words."""
    return plural(float(f"{number:.3g}"), word)


def bands(values, flags):
    """Runs of values at which something holds: '1, 2–3 …'; of many the first and the last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int)))
    runs = [f"{values[a]:g}" if b - a == 1 else f"{values[a]:g}–{values[b - 1]:g}"
            for a, b in edges.reshape(-1, 2)]
    return ", ".join(runs if len(runs) <= MOST else [*runs[:MOST // 2], "…", *runs[-MOST // 2:]])


def _besides(criticals, sweeps):
    """Critical values and sweeps along other parameters, in one sentence each."""
    said = []
    for one in criticals:
        attrs = one.attrs
        if attrs["parameter"] == "brake_torque" and not int(attrs.get("own_operation", 0)) \
                and attrs.get("safe_end", "high") == "high":
            continue
        at = f"at {attrs['brake_torque']:g} N·m " if "brake_torque" in attrs else ""
        if attrs["find"] == "full" and attrs["outcome"] == "found":
            value, unit = attrs["estimate"], UNITS.get(attrs["parameter"], "")
            limit = ("from", at_least(value)) if attrs.get("safe_end", "high") == "high" \
                else ("up to", at_most(value))
            said.append(f"{at}contact can be kept {limit[0]} a "
                        f"{parameter_words(attrs['parameter'])} of {limit[1]} {unit}".rstrip())
        else:
            said.append(f"{at}(`{attrs['name']}`) {headline(one)}")
    said = ["**Besides**: " + "; ".join(said) + "."] if said else []
    along = [_along(one, sweeps) for one in sweeps if one["status"].dims[1] != "brake_torque"]
    return said + [sentence for sentence in along if sentence]


def _along(sweep, sweeps):
    """Where the teeth part, and strike the coast flank, along another parameter."""
    parameter = sweep["status"].dims[1]
    unit, law = UNITS.get(parameter, ""), arrivals_in(sweep.attrs)
    found = looks((), (), [sweep], parameter)
    parting, back = (together(found, what) for what in ("rattling", "back"))
    if not parting.values.size:
        return ""
    at = f", at {sweep.attrs['brake_torque']:g} N·m" if "brake_torque" in sweep.attrs else ""
    text = f"**Along the {parameter_words(parameter)}** ({_span(parting.values, unit)}{at}) the " \
           "teeth "
    text += "part everywhere" if parting.seen.all() else "were not seen to part" \
        if not parting.seen.any() else f"part at {bands(parting.values, parting.seen)} {unit}, " \
        f"not at {bands(parting.values, ~parting.seen)} {unit}".replace(" ,", ",").rstrip()
    text += f"; back {law.word}s " + (f"at {bands(back.values, back.seen)} {unit}".rstrip()
                                      if back.seen.any() else "were not seen")
    lost = failures(found)
    return text + f"; {plural(lost, 'run')} failed" * bool(lost) + "."


def _span(values, unit):
    if values.size == 1:
        return f"{values[0]:g} {unit}".rstrip()
    return f"{values.size} values, {values[0]:g} to {values[-1]:g} {unit}".rstrip()
