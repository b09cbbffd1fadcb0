"""Studies along the transmission error itself: amplitudes of its series, and whole curves."""

import pickle

import numpy as np
import pytest
import xarray as xr

from helpers import PAIR, SHIPPED
from lapwing import Numerics, TransmissionError, parameter_map, simulate, sweep
from lapwing.base.arguments import Refusals
from lapwing.engine import Points
from lapwing.results.variables import write_groups
from lapwing.studies.sweep.curves import Curves, taken_axes
from lapwing.studies.sweep.varied import Varied, points_at

SERIES = TransmissionError.harmonic([17e-6, 4.5e-6, 1.5e-6], [0.0, 1.0, 2.0])
# A short series, a table, a series too long to be taken as one, a parabola with a kink.
CURVES = {"series": SERIES, "table": SHIPPED, "kinked": TransmissionError.parabola(125e-6),
          "long": TransmissionError.harmonic(np.full(9, 4e-6))}
AT = {"pinion_speed_rpm": 1500, "brake_torque": 1.8}
SHORT = {"settle": 10, "record": 5, **AT}


def with_second(amplitude):
    return TransmissionError.harmonic([17e-6, amplitude, 1.5e-6], [0.0, 1.0, 2.0])


@pytest.mark.parametrize("method", ["auto", "rk4"])
@pytest.mark.parametrize("threads", [1, 2])
def test_a_sweep_along_curves_has_the_numbers_of_each_alone(method, threads):
    """Whatever form each is taken in, all of them are in one call of the engine."""
    every = sweep(PAIR, SERIES, parameter="te", values=CURVES, threads=threads, method=method,
                  observe=("cycles", "impacts", "exponents"), **SHORT)
    assert every["te"].values.tolist() == list(CURVES)
    assert every["te"].attrs == {"long_name": "transmission error, by its label"}
    for label, te in CURVES.items():
        alone = sweep(PAIR, te, values=[1.8], starts=("rest",), method=method, settle=10, record=5,
                      observe=("cycles", "exponents"), pinion_speed_rpm=1500)
        for name in ("phi", "phi_dot", "impacts", "deepest_separation", "lyapunov_exponent"):
            found = every[name].sel(te=label).values
            assert found.tobytes() == alone[name].values[:, 0].tobytes()
    assert every.lapwing.impacts(te="table", start="rest").sizes["impact"] > 0


def test_a_result_tells_its_curves_apart(tmp_path):
    """By more than their labels: the same label may stand for another curve tomorrow."""
    def told(curves):
        found = sweep(PAIR, SERIES, parameter="te", values=curves, **SHORT)
        mapped = parameter_map(PAIR, SERIES, {"te": curves, "brake_torque": [1.0]}, settle=1,
                               record=1, pinion_speed_rpm=1500)
        for name in ("curve_source", "curve_peak_to_peak", "curve_sha256"):
            assert found[name].equals(mapped[name]) and found[name].dims == ("te",)
        write_groups(tmp_path / "a.nc", {"sweep_a": found})
        with xr.open_dataset(tmp_path / "a.nc", group="sweep_a") as data:
            return data.load()

    once, again = told(CURVES), told({**CURVES, "table": 1.000001 * SHIPPED})
    assert once["curve_peak_to_peak"].values.tolist() == [
        te.peak_to_peak for te in CURVES.values()]
    assert str(once["curve_source"].sel(te="kinked").values) == "parabola with 1 kink"
    changed = once["curve_sha256"].values != again["curve_sha256"].values
    assert list(once["te"].values[changed]) == ["table"]
    assert "curve_sha256" not in sweep(PAIR, SERIES, values=[1.8], settle=1, record=1,
                                       pinion_speed_rpm=1500)


def test_a_motion_is_carried_along_an_amplitude():
    """From curve to curve, as by hand: the state that one ends in begins the next."""
    values = [2e-6, 4e-6, 8e-6]
    found = sweep(PAIR, SERIES, parameter="harmonic_amplitude_2", values=values, starts=("up",),
                  **SHORT)
    assert found["harmonic_amplitude_2"].attrs == {
        "units": "rad", "long_name": "amplitude of term 2 of the transmission error's series"}
    start = "rest"
    for amplitude in values:
        run = simulate(PAIR.oscillator(with_second(amplitude), **AT), start=start, cycles=15,
                       numerics=Numerics(rtol=1e-6))
        recorded = found.sel(harmonic_amplitude_2=amplitude, start="up")
        assert recorded["phi"].values.tolist() == run.cycles["phi"].values[-5:].tolist()
        start = (run.final.motion_state, run.final.phi, run.final.phi_dot)


def test_numbers_of_the_oscillators_are_those_of_each():
    values = np.array([0.0, 4.5e-6, 2e-5])
    found = Varied(PAIR, SERIES, "harmonic_amplitude_2", values, AT).points
    expected = Points.of([PAIR.oscillator(with_second(value), **AT) for value in values])
    assert found.peak_to_peak.tobytes() == expected.peak_to_peak.tobytes()
    assert len({te.peak_to_peak for te in found.curves}) == 3
    both = points_at(PAIR, Curves(SERIES), {
        "harmonic_amplitude_2": values[[0, 1, 1, 2]], "brake_torque": np.ones(4)},
        {"pinion_speed_rpm": 1500})
    assert both.curve.tolist() == [0, 1, 1, 2] and len(both.curves) == 3
    some = both.take(np.array([3, 0]))
    assert [te.harmonics[1, 1] for te in (some.curves[i] for i in some.curve)] == [2e-5, 0.0]


def test_curves_are_made_once_and_outlive_their_process():
    curves = Curves(SERIES, {"kinked": CURVES["kinked"]})
    assert curves.at({"brake_torque": 1.0}) is SERIES
    assert curves.at({"te": "kinked"}) is CURVES["kinked"]
    one = curves.at({"harmonic_amplitude_1": 1e-6, "harmonic_amplitude_3": 0.0})
    assert one.harmonics[:, 1].tolist() == [1e-6, 4.5e-6, 0.0]
    assert one is curves.at({"harmonic_amplitude_1": 1e-6, "harmonic_amplitude_3": 0.0})
    other = pickle.loads(pickle.dumps(curves))
    assert other.at({"te": "kinked"}).coefficients.tobytes() == \
        CURVES["kinked"].coefficients.tobytes()


def test_axes_keep_the_order_of_labels_and_sort_numbers():
    values, curves = taken_axes(Refusals(), SERIES, {"te": {"z": SHIPPED, "a": SERIES},
                                                     "backlash": [2.0, 1.0, 2.0]})
    assert values["te"].tolist() == ["z", "a"] and values["backlash"].tolist() == [1.0, 2.0]
    assert curves.at({"te": np.str_("z")}) is SHIPPED


@pytest.mark.parametrize(("changed", "message"), [
    ({"values": {}}, "values = {}, expected {label: TransmissionError}"),
    ({"values": [SHIPPED]}, "expected {label: TransmissionError}"),
    ({"values": {"": SHIPPED}}, "expected {label: TransmissionError}"),
    ({"starts": ("rest", "up")}, "nothing is carried along 'te'"),
    ({"parameter": "harmonic_amplitude_4", "values": [1e-6]}, "harmonic_amplitude_4', expected"),
    ({"parameter": "harmonic_amplitude_0", "values": [1e-6]}, "harmonic_amplitude_0', expected")])
def test_what_is_no_curve_is_refused(changed, message):
    with pytest.raises(ValueError, match=message.replace("{", r"\{").replace("}", r"\}")):
        sweep(PAIR, SERIES, **{"parameter": "te", "values": CURVES, **SHORT, **changed})


def test_an_amplitude_wants_a_series():
    with pytest.raises(ValueError, match="harmonic_amplitude_1', expected one of"):
        sweep(PAIR, SHIPPED, parameter="harmonic_amplitude_1", values=[1e-6], **SHORT)
