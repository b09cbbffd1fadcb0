"""The form of the result file: older ones are read as those of today; Fortran reads its text."""

import ctypes
from pathlib import Path

import netCDF4
import numpy as np
import pytest
import xarray as xr

import lapwing
import sketches
from helpers import PAIR, dataset_bytes
from lapwing.base.arrivals import listed_impacts
from lapwing.results import SCHEMA_VERSION, read_results

DATA = Path(__file__).parent / "data"
NC_CHAR, NC_STRING = 2, 12


@pytest.fixture(scope="module")
def today(tmp_path_factory):
    """The results of the deck of the stored file, made now."""
    out = tmp_path_factory.mktemp("schema")
    lapwing.run_deck(lapwing.load_deck(DATA / "small.nml"), out, threads=1, figures="none")
    return out / "small" / "result.nc"


@pytest.fixture(scope="module", params=["with its version", "of version 0.1"])
def old(request, tmp_path_factory):
    """A stored file of version 1, and the same without what version 0.1 did not have."""
    path = tmp_path_factory.mktemp("old") / "result.nc"
    path.write_bytes((DATA / "schema_1.nc").read_bytes())
    if request.param == "of version 0.1":
        with netCDF4.Dataset(path, "a") as file:
            for name in ("schema_version", "checksums", "engine_sha256", "interrupted", "studies"):
                file.delncattr(name)
    return path


def test_old_files_are_read_in_the_form_of_today(old, today):
    with read_results(old) as before, read_results(today) as after:
        assert before.studies == after.studies
        assert before.verified == ("schema_version" in before.attrs)
        for kind, names in after.studies.items():
            for name in names:
                one, other = before.study(kind, name), after.study(kind, name)
                assert set(one.variables) == set(other.variables)
                assert set(one.coords) == set(other.coords)
                for key in other.variables:
                    assert one[key].dims == other[key].dims, key
                    # The numbers of another build of the engine may differ in the last bits.
                    if key == "flight_depth":
                        assert np.isnan(one[key]).all() and one[key].attrs == other[key].attrs
                    elif other[key].dtype.kind == "f":
                        np.testing.assert_allclose(one[key], other[key], rtol=1e-6, atol=1e-12)
                    else:
                        np.testing.assert_array_equal(one[key], other[key])


def test_figures_and_summary_are_made_from_old_files(old, tmp_path, monkeypatch):
    from lapwing.plots import draw_all
    from lapwing.report.summary import summary_text

    monkeypatch.setattr("lapwing.plots.style.save", sketches.save)  # drawn, not rendered
    with read_results(old) as results:
        assert "T_full" in summary_text(results)
        assert len(draw_all(results, tmp_path, formats=("png",))) >= 8


def types(path):
    """Type of every attribute, as netCDF numbers them, and of every variable."""
    folder = Path(netCDF4.__file__).parents[1] / "netcdf4.libs"
    found = sorted(folder.glob("libnetcdf*"))
    if not found:
        pytest.skip("this netCDF4 has no library of its own")
    library, ident = ctypes.CDLL(str(found[0])), ctypes.c_int()
    assert library.nc_open(str(path).encode(), 0, ctypes.byref(ident)) == 0
    types = {}
    with netCDF4.Dataset(path) as file:
        for group in (file, *file.groups.values()):
            number = ctypes.c_int(ident.value)
            if group is not file:
                assert library.nc_inq_ncid(ident, group.name.encode(), ctypes.byref(number)) == 0
            for place, owner in enumerate([group, *group.variables.values()], -1):
                for name in owner.ncattrs():
                    kind = ctypes.c_int()
                    assert library.nc_inq_atttype(number, place, name.encode(),
                                                  ctypes.byref(kind)) == 0
                    types[group.path, place, name] = kind.value
            for place, name in enumerate(group.variables):
                kind = ctypes.c_int()
                assert library.nc_inq_vartype(number, place, ctypes.byref(kind)) == 0
                types[group.path, name] = kind.value
    library.nc_close(ident)
    return types


def test_no_text_is_a_string(today):
    """NC_STRING cannot be read by netCDF-Fortran; the check itself sees those of an old file."""
    found = types(today)
    assert not [name for name, kind in found.items() if kind == NC_STRING]
    assert found["/", -1, "used_deck"] == found["/", -1, "deck_text"] == NC_CHAR
    assert found["/sweep_torque", "motion_class"] == NC_CHAR
    assert NC_STRING in types(DATA / "schema_1.nc").values()
    with read_results(today) as results:
        assert results.attrs["deck_text"] == (DATA / "small.nml").read_text(encoding="utf-8")
        assert results.sweep("torque")["claim_text"].values.tolist() == ["θ"]
        assert results.sweep("torque").sel(start="up")["motion_class"].dtype.kind in "OU"


def test_no_name_is_a_dimension_and_something_else(today):
    with netCDF4.Dataset(today) as file:
        assert file.schema_version == SCHEMA_VERSION
        for group in file.groups.values():
            for name in group.dimensions.keys() & group.variables.keys():
                assert group.variables[name].dimensions[0] == name


def test_impacts_are_a_contiguous_ragged_array(today):
    with read_results(today) as results:
        sweep = results.sweep("torque")
        assert sweep["kept_impacts"].attrs["sample_dimension"] == "impact"
        kept = sweep["kept_impacts"].values
        assert kept.sum() == sweep.sizes["impact"] > 0
        np.testing.assert_array_equal(sweep["first_impact"].values.ravel(),
                                      np.cumsum(kept.ravel()) - kept.ravel())
        one = sweep.lapwing.impacts(start="up", brake_torque=0.68)
        assert (float(one["brake_torque"]), str(one["start"].values)) == (0.7, "up")
        assert one.sizes["impact"] == kept[1, 1] > 0
        both = sweep.lapwing.impacts(brake_torque=0.7)
        np.testing.assert_array_equal(both["start"] == "up", np.repeat([False, True], kept[:, 1]))
        place, point = listed_impacts(sweep.isel(start=slice(None, None, -1)))
        assert point.size == kept.sum() and np.all(np.diff(point) >= 0)
        assert place[0] == sweep["first_impact"].values[1, 0]


def test_words_from_python_are_those_of_the_file(tmp_path):
    """Units, long names and flags; whole numbers are such in the file alone."""
    from lapwing.results.variables import described

    swept = lapwing.sweep(PAIR, lapwing.TransmissionError.harmonic([5e-5]), values=[1.0, 2.0],
                          pinion_speed_rpm=240, settle=5, record=4,
                          observe=("cycles", "impacts", "speeds", "exponents"))
    for name, variable in described(swept.copy(deep=True)).variables.items():
        assert dict(swept[name].attrs).keys() == dict(variable.attrs).keys(), name
        for key in ("units", "long_name"):
            assert swept[name].attrs.get(key) == variable.attrs.get(key), name
    swept.to_netcdf(tmp_path / "by_hand.nc")
    with xr.open_dataset(tmp_path / "by_hand.nc") as again:
        assert dataset_bytes(again.drop_vars(["start", "motion_class"])) \
            == dataset_bytes(swept.drop_vars(["start", "motion_class"]))
