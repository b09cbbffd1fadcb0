"""The one table of parameters: every number that can be varied is in it, with the deck's unit."""

import pytest

from lapwing.base.quantities import PARAMETERS, parameter
from lapwing.deck.declare import KeyType, fields
from lapwing.deck.schema import GROUPS, numeric_parameters
from lapwing.results.variables import DESCRIPTIONS


def test_every_parameter_is_in_the_table():
    assert set(numeric_parameters()) == set(PARAMETERS)


@pytest.mark.parametrize("name", PARAMETERS)
def test_units_agree_with_the_deck_and_the_file(name):
    unit = KeyType(fields(GROUPS[numeric_parameters()[name]])[name]).unit
    assert unit == PARAMETERS[name].shown
    assert DESCRIPTIONS[name] == (PARAMETERS[name].units, PARAMETERS[name].long_name)
    # UDUNITS has no multiplication dot and no superscript.
    assert PARAMETERS[name].shown.replace("·", " ").replace("²", "2") in (
        PARAMETERS[name].units, "")


def test_an_unknown_name_is_a_bare_number():
    assert parameter("some_number").words == "some number" and not parameter("some_number").shown
