"""Each deck in refused/ is refused with exactly the messages of the text file beside it."""

from pathlib import Path

import pytest

from lapwing.deck import DeckError, load_deck

REFUSED = Path(__file__).with_name("refused")
DECKS = sorted(REFUSED.glob("*.nml"))


@pytest.mark.parametrize("deck", DECKS, ids=lambda path: path.stem)
def test_messages(deck, monkeypatch):
    monkeypatch.chdir(REFUSED)
    with pytest.raises(DeckError) as caught:
        load_deck(deck.name)
    expected = deck.with_suffix(".txt").read_text(encoding="utf-8").splitlines()
    assert [str(problem) for problem in caught.value.problems] == expected


@pytest.mark.parametrize("path", ["nowhere.nml", ".", "a\0b.nml"])
def test_unreadable_deck(path):
    with pytest.raises(DeckError, match="cannot be read"):
        load_deck(path)


def test_position_of_a_problem():
    with pytest.raises(DeckError) as caught:
        load_deck(REFUSED / "unknown_key.nml")
    first = caught.value.problems[0]
    assert (first.line, first.column, first.warning) == (8, 3, False)
    assert str(first).startswith(f"{REFUSED / 'unknown_key.nml'}:8:3: unknown key brake_torqe")


GOOD = (REFUSED.parent / "accepted" / "plain.nml").read_text(encoding="utf-8")


@pytest.mark.parametrize(("key", "value", "message"), [
    ("operation.brake_torque", "x",
     "brake_torque = x, expected a number from -1e+09 to 1e+09 (N·m)"),
    ("operation.brake_torque", "1,8", "brake_torque = 1,8: decimal comma; write 1.8"),
    ("operation.brake_torque", "2 /", "'2 /' is no value"),
    ("operation.brake_torque", "", "brake_torque has no value"),
    ("operation.brake_torqe", "2", "unknown key brake_torqe in &operation; "
                                   "did you mean 'brake_torque'?"),
    ("brake_torque", "2", "expected group.key, or response.NAME.key; known are gear_pair, "
     "transmission_error, operation, scene, numerics, draw, response, sweep, critical, map, "
     "ensemble, branches, basins, attractors"),
    ("sweep.nosuch.count", "2", "which &sweep? expected sweep.NAME.key with one of none in this "
                                "deck"),
    ("operation.mesh_frequency_hz", "100", "pinion_speed_rpm and mesh_frequency_hz are both "
     "given; expected one of pinion_speed_rpm, pinion_speed_rad_s, mesh_frequency_hz"),
])
def test_override(tmp_path, key, value, message):
    deck = tmp_path / "deck.nml"
    deck.write_text(GOOD, encoding="utf-8")
    with pytest.raises(DeckError) as caught:
        load_deck(deck, [(key, value)])
    assert [str(problem) for problem in caught.value.problems] == \
        [f"--set {key}={value}: {message}"]
