"""Template, reference page and schema agree with each other and with the engine's own limits."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from lapwing.deck import load_deck, reference_page, template_text
from lapwing.deck.schema import GROUPS, KeyType, fields
from lapwing.engine import Numerics

ROOT = Path(__file__).parents[2]


def test_template_loads(tmp_path):
    path = tmp_path / "new.nml"
    path.write_text(template_text(), encoding="utf-8")
    deck = load_deck(path)
    assert not deck.warnings and {kind for kind, asked in deck.studies.items() if asked} \
        == {"response", "sweep", "critical"}
    assert max(map(len, template_text().splitlines())) <= 100


def test_groups_for_other_questions_load_without_their_marks(tmp_path):
    path = tmp_path / "new.nml"
    path.write_text(re.sub(r"^! (?=[&/ ])", "", template_text(), flags=re.MULTILINE),
                    encoding="utf-8")
    deck = load_deck(path)
    assert not deck.warnings and all(deck.studies.values())


def test_template_names_every_key():
    named = set(re.findall(r"^(?:! )? +(?:! )?(\w+) = ", template_text(), re.MULTILINE))
    assert named == {key for group in GROUPS.values() for key in fields(group)}


def test_reference_page_is_current():
    page = (ROOT / "docs" / "deck.md").read_text(encoding="utf-8")
    assert page == reference_page(), "python -m lapwing.deck.reference > docs/deck.md"


def test_examples_of_the_page_load(tmp_path):
    blocks = re.findall(r"```fortran\n(.*?)```", reference_page(), re.DOTALL)
    table = re.search(r"```\n(# measured.*?)```", reference_page(), re.DOTALL)[1]
    (tmp_path / "measured.csv").write_text(table, encoding="utf-8")
    shipped = (ROOT / "inputs" / "te_25x32.csv").read_text(encoding="utf-8")
    (tmp_path / "te_25x32.csv").write_text(shipped, encoding="utf-8")
    path = tmp_path / "deck.nml"
    ranges = f"&sweep name = 'b' parameter = 'brake_torque' {blocks[4]} /"
    path.write_text("\n".join([*blocks[:2], ranges]), encoding="utf-8")
    deck = load_deck(path)
    assert len(deck.sweeps[0].values) == 691 and len(deck.sweeps[1].values) == 301
    path.write_text(blocks[2], encoding="utf-8")
    deck = load_deck(path)
    assert not deck.warnings and [one.name for one in deck.responses] == ["from_rest",
                                                                          "from_mid_gap"]
    fits = blocks[3].strip().splitlines()
    rows = "".join(f"{i / 20},{i % 5},0\n" for i in range(20))
    (tmp_path / "measured.csv").write_text(
        "phase,transmission_error[urad],kink\n" + rows, encoding="utf-8")
    for fit in fits:
        path.write_text(re.sub("&transmission_error.*", fit, blocks[2]), encoding="utf-8")
        assert load_deck(path).curve.method in fit
    assert len(fits) == 2
    (tmp_path / "measured.csv").write_text(table, encoding="utf-8")
    path.write_text(blocks[2], encoding="utf-8")
    deck = load_deck(path)
    # What the page says of this pair: ξ = 0.047, one period is 24° of pinion rotation.
    assert round(deck.gear_pair.xi, 3) == 0.047
    assert deck.te.knots.tolist() == pytest.approx([0, 5 / 24, 12 / 24, 18.5 / 24, 1])
    assert deck.te.kinks.tolist() == [True, False, False, False]


def test_the_page_explains_the_source_at_its_first_use():
    page = " ".join(reference_page().split())
    assert page.index("the source") == page.index("*the source* below") + 1


@pytest.mark.parametrize("key", ["rtol", "chatter_tol", "count_depth", "max_events_per_cycle",
                                 "max_steps_per_cycle"])
def test_limits_are_those_of_the_engine(key):
    limits = KeyType(fields(GROUPS["numerics"])[key]).limits
    whole = isinstance(limits["le"], int) and "max" in key
    low = limits.get("ge", limits.get("gt"))
    inside = [limits["le"], low] if "ge" in limits else [limits["le"]]
    for value in inside:
        Numerics(**{key: value})
    below = low - 1 if whole else low - 1e-15 if "ge" in limits else low
    for value in (limits["le"] * 1.001 if not whole else limits["le"] + 1, below):
        with pytest.raises(ValueError, match=key):
            Numerics(**{key: value})


def test_checking_a_deck_imports_nothing_heavy():
    code = ("import sys; from lapwing.deck import load_deck; load_deck(sys.argv[1]); "
            "print([m for m in ('scipy', 'xarray', 'matplotlib', 'lapwing._engine') "
            "if m in sys.modules])")
    deck = ROOT / "inputs" / "lapping_25x32.nml"
    done = subprocess.run([sys.executable, "-c", code, deck], capture_output=True, text=True,
                          check=True)
    assert done.stdout.strip() == "[]"
