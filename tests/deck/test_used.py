"""used.nml reads back to the same values; the hash sees values and nothing else."""

from pathlib import Path

import hypothesis.strategies as st
import pytest
from hypothesis import example, given, settings

from lapwing.deck import changed_keys, load_deck, used_hash, used_text
from lapwing.deck.used import canonical, stored_hash

HERE = Path(__file__).parent
INPUTS = HERE.parents[1] / "inputs"
DECKS = [*sorted((HERE / "accepted").glob("*.nml")), *sorted(INPUTS.glob("*.nml"))]
PLAIN = HERE / "accepted" / "plain.nml"


def reread(deck, folder, relative=True):
    path = folder / "used.nml"
    path.write_text(used_text(deck, folder if relative else None), encoding="utf-8")
    return load_deck(path)


@pytest.mark.parametrize("relative", [True, False])
@pytest.mark.parametrize("path", DECKS, ids=lambda path: path.stem)
def test_reads_back(path, relative, tmp_path):
    deck = load_deck(path)
    again = reread(deck, tmp_path, relative)
    assert canonical(again) == canonical(deck) and changed_keys(deck, again) == ()
    assert stored_hash(again.text) == used_hash(deck) == used_hash(again)
    assert again.gear_pair == deck.gear_pair and again.operation == deck.operation
    responses = [[(one.operation, one.start, one.keys.used(one)) for one in each.responses]
                 for each in (again, deck)]
    assert responses[0] == responses[1]
    assert [s.values.tolist() for s in again.sweeps] == [s.values.tolist() for s in deck.sweeps]
    assert [(c.starts, c.record_cycles, c.operation) for c in again.criticals] \
        == [(c.starts, c.record_cycles, c.operation) for c in deck.criticals]


def numbers(low, high):
    return st.floats(low, high, allow_subnormal=False)


OVERRIDES = st.fixed_dictionaries({}, optional={
    "operation.brake_torque": numbers(-1e9, 1e9), "operation.drive_torque": numbers(-1e9, 1e9),
    "gear_pair.restitution": numbers(0, 1), "gear_pair.backlash": numbers(1e-9, 1),
    "gear_pair.pinion_inertia": numbers(1e-9, 1e3), "gear_pair.gear_teeth": st.integers(1, 1000),
    "numerics.rtol": numbers(1e-13, 1e-2), "numerics.start_phase": numbers(0, 0.999),
    "transmission_error.parabola_amplitude": numbers(-1, 1),
    "response.claim_text": st.text(st.characters(categories=["L", "N", "P", "S"]), max_size=40)
                             .map(lambda text: "'" + text.replace("'", "''") + "'"),
    "response.record_cycles": st.integers(1, 1_000_000)})


@settings(max_examples=60, deadline=None)
@given(OVERRIDES)
@example({"transmission_error.parabola_amplitude": -0.0})
def test_any_values_read_back(tmp_path_factory, overrides):
    deck = load_deck(PLAIN, [(key, str(value)) for key, value in overrides.items()])
    text = used_text(deck)
    assert text.count("  ! --set\n") == len(overrides)
    again = reread(deck, tmp_path_factory.mktemp("used"))
    assert canonical(again) == canonical(deck) and used_hash(again) == used_hash(deck)


def test_marks():
    deck = load_deck(PLAIN, [("response.a.settle_cycles", "10")])
    text = used_text(deck)
    assert "  settle_cycles = 10  ! --set\n" in text
    assert "! --set response.a.settle_cycles=10\n" in text
    assert "  record_cycles = 100  ! default\n" in text
    assert "  brake_torque = 1.8\n" in text
    assert "! drive_torque: left out, the balance T_l/i12" in text


def written(tmp_path, text):
    path = tmp_path / "deck.nml"
    path.write_text(text, encoding="utf-8")
    return load_deck(path)


def test_hash_ignores_spelling(tmp_path):
    text = PLAIN.read_text(encoding="utf-8")
    *groups, last = text.split("\n&")
    shuffled = "&" + "\n&".join([last.strip(), *reversed(groups[1:]), groups[0][1:]])
    shuffled = shuffled.replace("125e-6", "1.25d-04 ! a comment\n").replace("240", "2.4E2")
    assert used_hash(written(tmp_path, shuffled)) == used_hash(load_deck(PLAIN))


@pytest.mark.parametrize(("old", "new"), [
    ("brake_torque = 1.8", "brake_torque = 1.8000000000000003"), ("32", "33"), ("'a'", "'b'"),
    ("125e-6", "126e-6"), ("/\n&operation", ", te_sign = 'geometric' /\n&operation")])
def test_hash_sees_values(tmp_path, old, new):
    text = PLAIN.read_text(encoding="utf-8")
    assert old in text
    assert used_hash(written(tmp_path, text.replace(old, new))) != used_hash(load_deck(PLAIN))


def test_hash_sees_the_table_not_its_file(tmp_path):
    plain = load_deck(INPUTS / "minimal.nml")
    table = (INPUTS / "te_25x32.csv").read_text(encoding="utf-8")
    (tmp_path / "other.csv").write_text("# moved\n" + table.replace("0.0,", "0.00 ,"))
    text = plain.text.replace("te_25x32.csv", "other.csv")
    assert used_hash(written(tmp_path, text)) == used_hash(plain)
    (tmp_path / "other.csv").write_text(table.replace("3.380e-3", "3.381e-3"))
    moved = written(tmp_path, text)
    assert used_hash(moved) != used_hash(plain)
    assert [line.partition(":")[0] for line in changed_keys(plain, moved)] == [
        "transmission_error.table"]


def test_changed_keys():
    old = load_deck(PLAIN)
    new = load_deck(PLAIN, [("operation.brake_torque", "2")])
    assert changed_keys(old, new) == ("operation.brake_torque: 1.8 -> 2.0",)


def test_curves_enter_the_hash_by_their_numbers_and_labels(tmp_path):
    """Where a file lies and how it is written does not; what it holds, its label and order do."""
    text = (HERE / "accepted" / "curves.nml").read_text(encoding="utf-8").replace(
        "'../", f"'{HERE / 'accepted'}/../")
    table = "phase,transmission_error\n0,0\n0.3,2e-5\n0.6,1e-5\n"
    for name, content in (("one.csv", table), ("same.csv", table.replace("2e-5", "20e-6")),
                          ("other.csv", table.replace("2e-5", "3e-5"))):
        (tmp_path / name).write_text(content, encoding="utf-8")
    path = tmp_path / "deck.nml"
    path.write_text(text, encoding="utf-8")

    def hashed(files, labels):
        return used_hash(load_deck(path, [("sweep.curves.files", files),
                                          ("sweep.curves.labels", labels)]))
    known = hashed("one.csv, other.csv", "a, b")
    assert known == hashed("same.csv, other.csv", "a, b")
    assert known != hashed("other.csv, other.csv", "a, b")
    assert known != hashed("one.csv, other.csv", "a, c")
    assert known != hashed("other.csv, one.csv", "b, a")
