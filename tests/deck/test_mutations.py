"""Damaged decks: refused with positions, or accepted with what an independent reader finds."""

import re
from datetime import timedelta
from pathlib import Path

import f90nml
import hypothesis.strategies as st
import pytest
from hypothesis import HealthCheck, given, settings

from lapwing.deck import DeckError, load_deck, used_hash, used_text
from lapwing.deck.schema import GROUPS, REPEATED
from lapwing.engine import Numerics

HERE = Path(__file__).parent
INPUTS = sorted((HERE.parents[1] / "inputs").glob("*.nml"))
BASES = {path.stem: path.read_text(encoding="utf-8-sig").replace("'te_25x32.csv'", "'te.csv'")
         for path in [*sorted((HERE / "accepted").glob("*.nml")), *INPUTS]}
TABLE = (HERE.parents[1] / "inputs" / "te_25x32.csv").read_text(encoding="utf-8")
PIECES = [
    "#", "/", "&", "&end", "$", "'", '"', ",", ",,", "=", "!", "\n", "\r\n", "\r", "\t", " ", "*",
    "3*", "0*1", "2*1.5", "999999999*1", "1*", "NaN", "-inf", "Infinity", "1e999", "1d-400", "-1",
    "0", "0,5", "1.5", "1e", "1e5", "12345678901234567890", "9" * 5000, "Nm", " N·m", "1_8", "0x10",
    "−1", "١", ".true.", ".F.", "T", "true", "'rest'", "'up'", "''", "(1)", "%x", "\ufeff", "\0",
    "\u00a0", "\u2028", "\x1c", "é", "&sweep", "&response name = 'z' /", "&gear_pair", "name = 'q'",
    "values = 1 2 3", "from", "brake_torque = ", "rtol = 1e-3", "file = 'te.csv'", "file = '.'",
    "te_sign = 'geometric'", "start = 'separation'", "contact_law = 'rigid'", "T_l", "gap =",
    "find = 'on'", "back_flank_te = F", "parameter = 'backlash'", "count = 2", "spacing = 'log'"]
EDITS = st.lists(st.tuples(
    st.sampled_from(["insert", "delete", "replace", "repeat_line", "drop_line", "swap_case"]),
    st.floats(0, 1), st.integers(1, 12), st.one_of(st.sampled_from(PIECES), st.text(max_size=4))),
    min_size=1, max_size=4)


def mutate(text, edits):
    """The text after edits; positions are fractions of its length."""
    for kind, fraction, length, piece in edits:
        at = int(fraction * len(text))
        if kind in ("insert", "replace", "delete"):
            keep = at if kind == "insert" else at + length
            text = text[:at] + ("" if kind == "delete" else piece) + text[keep:]
        elif kind == "swap_case":
            text = text[:at] + text[at:at + length].swapcase() + text[at + length:]
        else:
            lines = text.split("\n")
            i = min(int(fraction * len(lines)), len(lines) - 1)
            lines[i:i + 1] = [lines[i]] * (2 if kind == "repeat_line" else 0)
            text = "\n".join(lines)
    return text


def groups_of(text):
    """Every group of a deck as f90nml reads it: (name, {key: value}), in order."""
    oracle = f90nml.reads(text)
    for name, group in oracle.items():
        for one in group if isinstance(group, list) else [group]:
            yield name, dict(one)


def plain_blanks(value):
    return re.sub(r"[^\S\n]", " ", value) if isinstance(value, str) else value


def without_point(value):
    """F90nml reads `true.`, a logical to Fortran, as a logical and a point."""
    return value[0] if isinstance(value, list) and len(value) == 2 \
        and isinstance(value[0], bool) and value[1] == "." else value


def check_accepted(deck, folder):
    """What was accepted means the same to f90nml, to the driver and after a round trip."""
    # f90nml knows neither other blanks nor lone carriage returns.
    text = plain_blanks(deck.text)
    theirs = list(groups_of(text))
    ours = [(name, one.model_dump(by_alias=True, exclude_unset=True)) for name in GROUPS
            for one in (deck.settings[name] if name in REPEATED else [deck.settings[name]])]
    for name in GROUPS:
        mine = [keys for group, keys in ours if group == name]
        other = [keys for group, keys in theirs if group == name] or [{}] * (name not in REPEATED)
        assert len(mine) == len(other)
        for one, two in zip(mine, other, strict=True):
            one = {key: plain_blanks(value) for key, value in one.items()}
            two = {key: without_point(value) for key, value in two.items()}
            two = {key: value if isinstance(value, list) == isinstance(one.get(key), list)
                   else [value] for key, value in two.items()}
            assert one == two
    for study in (*deck.responses, *deck.sweeps, *deck.criticals):
        Numerics(**deck.numerics_of(study))
    for response in deck.responses:
        deck.oscillator(response)
    path = folder / "used.nml"
    path.write_text(used_text(deck, folder), encoding="utf-8")
    assert used_hash(load_deck(path)) == used_hash(deck)


def try_deck(text, folder):
    path = folder / "deck.nml"
    path.write_text(text, encoding="utf-8", errors="replace", newline="")
    try:
        deck = load_deck(path)
    except DeckError as error:
        assert error.problems
        lines = text.count("\n") + text.count("\r") + 1
        for problem in error.problems:
            assert problem.text and not problem.warning
            assert problem.file in (str(path), str(folder / "te.csv"), str(folder))
            assert 0 <= problem.line <= lines and "\n" not in str(problem)
        return
    check_accepted(deck, folder)


def mutations(examples):
    # The deadline is there to catch a hang; a damaged deck takes milliseconds.
    @settings(max_examples=examples, deadline=timedelta(seconds=10),
              suppress_health_check=list(HealthCheck), derandomize=examples < 1000)
    @given(st.sampled_from(list(BASES.values())), EDITS)
    def run(folder, base, edits):
        try_deck(mutate(base, edits), folder)
    return run


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "te.csv").write_text(TABLE, encoding="utf-8")
    return tmp_path


def test_mutations(folder):
    mutations(150)(folder)


@pytest.mark.full
def test_ten_thousand_mutations(folder):
    mutations(10_000)(folder)


# What must be refused wherever it is done: a pattern that marks the places, and the replacement.
NUMBER = r"(?<==)( *)([0-9.]+(?:[ed][-+]?[0-9]+)?)(?=[ ,\n]*(?:\n|[a-z_]+ *=|/))"
FORBIDDEN = {
    "unit": (NUMBER, r"\1\2 Nm"), "glued unit": (NUMBER, r"\1\2mm"), "NaN": (NUMBER, r"\1NaN"),
    "infinity": (NUMBER, r"\1-Inf"), "logical": (NUMBER, r"\1.true."), "text": (NUMBER, r"\1'\2'"),
    "underscore": (NUMBER, r"\1\2_8"), "huge": (NUMBER, r"\g<1>1e300"), "none": (NUMBER, r"\1"),
    "comma": (r"(?<== )0\.(?=[0-9])", "0,"), "sharp": (r"!|$", "#"), "slash": (r"/(?=[\n ])", " "),
    "key": (r"[a-z_]+(?= *=)", r"\g<0>x"), "group": (r"&[a-z_]+", r"\g<0>s"),
    "twice": (r"([a-z_]+ *= *[^ ,\n!/]+)(?=[ ,\n])", r"\1, \1"),
}


@pytest.mark.parametrize(("what", "bases"), [
    *((what, ("plain", "minimal")) for what in FORBIDDEN),
    *(pytest.param(what, tuple(path.stem for path in INPUTS), marks=pytest.mark.full)
      for what in FORBIDDEN)])
def test_forbidden_wherever_it_stands(what, bases, folder):
    pattern, replacement = FORBIDDEN[what]
    tried = 0
    for base in map(BASES.get, bases):
        bare = re.sub("![^\n]*", "", base) if what != "sharp" else base
        for match in re.finditer(pattern, bare):
            damaged = bare[:match.start()] + match.expand(replacement) + bare[match.end():]
            (folder / "deck.nml").write_text(damaged, encoding="utf-8")
            with pytest.raises(DeckError):
                load_deck(folder / "deck.nml")
            tried += 1
    assert tried > 4
