"""The Dataset of a sweep, made from a kept form, is one that xarray makes by itself."""

import copy
import pickle

import numpy as np
import pytest
import xarray as xr

import lapwing
from helpers import PAIR, SHIPPED
from lapwing.base.quantities import worded


def run(torques=(1.8, 3.3, 5.5), **changed):
    options = {"settle": 4, "record": 6, "observe": ("cycles", "impacts"), "threads": 1,
               "pinion_speed_rpm": 240, "impact_law": "absolute"} | changed
    return lapwing.sweep(PAIR, SHIPPED, values=torques, **options)


def by_xarray(data):
    """The same by the public constructor, which checks everything."""
    variables = {name: (one.dims, one.values) for name, one in data.variables.items()}
    coords = {name: variables.pop(name) for name in data.coords}
    return worded(xr.Dataset(variables, coords, data.attrs))


@pytest.fixture(scope="module")
def made():
    return run()


def test_it_is_what_the_constructor_makes(made):
    other = by_xarray(made)
    xr.testing.assert_identical(made, other)
    assert type(made) is xr.Dataset
    assert repr(made) == repr(other) and list(made.dims) == list(other.dims)
    assert list(made.variables) == list(other.variables) and dict(made.sizes) == dict(other.sizes)
    assert set(made.coords) == set(other.coords) and set(made.xindexes) == set(other.xindexes)
    for name, one in made.variables.items():
        assert type(one) is type(other.variables[name]) and one.encoding == {}
        assert one.dtype == other.variables[name].dtype


def test_without_the_short_way_it_is_the_same(made, monkeypatch):
    own = xr.Dataset._construct_direct
    taken = []
    monkeypatch.setattr(xr.Dataset, "_construct_direct", classmethod(
        lambda cls, *args, **named: taken.append(1) or own(*args, **named)))
    run()
    assert taken
    # As if this xarray had none.
    monkeypatch.setattr("lapwing.studies.sweep.form.SHORT_WAY", "_no_such_way")
    xr.testing.assert_identical(run(), made)


def test_it_selects_copies_and_goes_into_a_file(made, tmp_path):
    xr.testing.assert_identical(pickle.loads(pickle.dumps(made)), made)
    xr.testing.assert_identical(copy.deepcopy(made), made)
    one = made.sel(start="up", brake_torque=3.3)
    assert float(one.force) == made.force.values[1]
    longer = xr.concat([made.phi, run((6.0, 7.0)).phi], "brake_torque")
    assert longer.brake_torque.values.tolist() == [1.8, 3.3, 5.5, 6.0, 7.0]
    made.to_netcdf(tmp_path / "sweep.nc")
    with xr.open_dataset(tmp_path / "sweep.nc") as read:
        for name, variable in made.variables.items():
            np.testing.assert_array_equal(read[name].values, variable.values)


def test_results_share_nothing_that_can_be_written(made):
    first = run()
    for variable in first.variables.values():
        variable.attrs["long_name"] = "spoilt"
    first.attrs.clear()
    first["phi"].values[:] = 0.0
    first["new"] = ("brake_torque", [1, 2, 3])
    first = first.assign_coords(brake_torque=[0, 1, 2])
    xr.testing.assert_identical(run(), made)


def test_other_values_have_their_own_coordinates(made):
    other = run((1.8, 3.4, 5.5))
    assert other.brake_torque.values.tolist() == [1.8, 3.4, 5.5]
    assert other.indexes["brake_torque"].get_loc(3.4) == 1
    assert made.brake_torque.values.tolist() == [1.8, 3.3, 5.5]
