"""The converters that everything passes on its way to the engine."""

import math
from fractions import Fraction

import numpy as np
import pytest

from lapwing.base import arguments
from lapwing.base.arguments import LEAST, MAX_INT, MOST

NUMBERS = [1, 1.0, np.float32(1), np.float64(1), np.int8(1), np.uint64(1), np.array(1.0),
           np.array(1, dtype=np.int16), Fraction(1), np.longdouble(1)]


@pytest.mark.parametrize("value", NUMBERS, ids=repr)
def test_numbers_of_every_kind_are_numbers(value):
    taken = arguments.real("x", value)
    assert (type(taken), taken) == (float, 1.0)


@pytest.mark.parametrize("value", [None, True, np.True_, "1", b"1", 1 + 0j, np.complex128(1), [1.0],
                                   np.ones(1), np.ma.masked, {}, object(), np.array(None)])
def test_what_is_no_number_is_a_type_error(value):
    for converter in (arguments.real, arguments.whole):
        with pytest.raises(TypeError, match=r"^x = .*, expected a (whole )?number"):
            converter("x", value)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 10**400, -10**400, 1e308,
                                   np.float32(np.inf), Fraction(10**400)])
def test_what_cannot_be_computed_with_is_a_value_error(value):
    for converter in (arguments.real, arguments.positive, arguments.whole):
        with pytest.raises(ValueError, match=r"^x = .*, expected"):
            converter("x", value)


def test_the_ends_of_a_range():
    assert arguments.positive("x", LEAST) == LEAST
    assert arguments.real("x", -MOST) == -MOST
    for value in (0.0, 5e-324, np.nextafter(LEAST, 0), np.nextafter(MOST, math.inf)):
        with pytest.raises(ValueError, match="x"):
            arguments.positive("x", value)
    assert arguments.phase("x", np.nextafter(1, 0)) < 1
    for value in (1.0, -5e-324):
        with pytest.raises(ValueError, match=r"from 0 to below 1|from 0 below 1"):
            arguments.phase("x", value)


def test_products_of_two_squares_stay_numbers():
    """What the range of the parameters is chosen for."""
    assert math.isfinite(MOST**2 * MOST**2)
    assert LEAST**2 * LEAST**2 > np.finfo(float).tiny


def test_whole_numbers_fit_the_engine():
    top = MAX_INT - 1
    assert arguments.whole("n", np.int64(top)) == top < np.iinfo(np.intc).max
    for value in (MAX_INT, 2**31, 2**63, -1, 1.5, 1.0):
        with pytest.raises(ValueError, match="whole number from 0 to"):
            arguments.whole("n", value)


@pytest.mark.parametrize("value", ["x" * 10**6, 10**5000, list(range(10**5)), np.zeros(10**6),
                                   {"a": "x" * 10**5}, b"y" * 10**6], ids=lambda v: str(type(v)))
def test_messages_are_bounded(value):
    with pytest.raises((TypeError, ValueError)) as caught:
        arguments.real("x", value)
    assert len(str(caught.value)) < 200


def test_a_repr_that_fails_is_no_failure():
    class Rude:
        def __repr__(self):
            raise RuntimeError

    with pytest.raises(TypeError, match="an object of type Rude"):
        arguments.real("x", Rude())


@pytest.mark.parametrize("value", [[1, 2], (1.0, 2.0), np.array([1, 2], dtype=np.int8),
                                   np.array([1.0, 9.0, 2.0])[::2], range(1, 3),
                                   np.ma.masked_array([1.0, 2.0], mask=False),
                                   np.array([1, 2], dtype=object)])
def test_arrays_become_contiguous_doubles(value):
    taken = arguments.reals("x", value, ndim=1)
    assert (type(taken), taken.dtype) == (np.ndarray, float)
    assert taken.flags.c_contiguous
    assert taken.tolist() == [1.0, 2.0]


def test_an_array_is_copied():
    given = np.array([1.0, 2.0])
    arguments.reals("x", given)[0] = 5.0
    assert given[0] == 1.0


@pytest.mark.parametrize(("value", "kind"), [
    (None, TypeError), ("12", TypeError), ([True], TypeError), ([1j], TypeError),
    (np.ma.masked_array([1.0], mask=[True]), TypeError), (np.ma.masked, TypeError),
    ([None], TypeError), ([object()], TypeError), ([], ValueError), ([math.nan], ValueError),
    ([10**400], ValueError), ([1.0, [2.0]], ValueError), (np.ones((2, 2)), ValueError),
    ([1e308], ValueError)])
def test_refused_arrays(value, kind):
    with pytest.raises(kind, match=r"^x (=|is empty)"):
        arguments.reals("x", value, ndim=1)


@pytest.mark.parametrize(("converter", "value", "more"), [
    (arguments.flag, 1, ()), (arguments.flag, "True", ()), (arguments.flag, None, ()),
    (arguments.choice, 1, (("a", "b"),)), (arguments.choice, ["a"], (("a", "b"),)),
    (arguments.choices, "c", (("a", "b"),)), (arguments.choices, None, (("a", "b"),)),
    (arguments.function, 1, ()), (arguments.instance, 1, (str,)), (arguments.path, 1, ()),
    (arguments.path, True, ())])
def test_refused_types(converter, value, more):
    with pytest.raises(TypeError, match=r"^x = .*, expected"):
        converter("x", value, *more)


@pytest.mark.parametrize(("converter", "value", "more"), [
    (arguments.choice, "c", (("a", "b"),)), (arguments.choices, ("a", "a"), (("a", "b"),)),
    (arguments.choices, ([],), (("a", "b"),)), (arguments.path, "a\0b", ())])
def test_refused_words(converter, value, more):
    with pytest.raises(ValueError, match=r"^x = .*, expected"):
        converter("x", value, *more)
