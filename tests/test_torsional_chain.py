"""Two degrees of freedom: against the two bodies integrated as such, and against the oscillator."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from helpers import ROOT
from lapwing import EventKind, GearPair, TransmissionError, simulate, sweep
from lapwing.deck import load_deck
from lapwing.engine import Numerics, TrajectoryCall, Wanted
from lapwing.model.oscillator import ParameterError
from lapwing.plots.response import shaft_motion
from lapwing.studies.response.run import response
from lapwing.studies.stability import CycleMaps, multiplied

PAIR = GearPair(25, 32, 0.0078, 0.026, 0.034, 3.12e8, 0.002, 0.8, damping_ratio=0.1)
# A table, not a series: the engine's rk4 takes a series from a table, which is not quite the same.
PHASE = np.arange(24) / 24
TE = TransmissionError.from_samples(PHASE, sum(
    a * np.cos(2 * math.pi * n * PHASE + shift)
    for n, a, shift in ((1, 17e-6, 0), (2, 4.5e-6, 1), (3, 1.5e-6, 2))))
SPEED = {"pinion_speed_rpm": 1500}
# SciPy finds events to an absolute tolerance: time in units of the natural frequency, about.
UNIT = 1e-4


def chain(brake, drive=None, te=TE, **other):
    return PAIR.oscillator(te, brake_torque=brake, drive_torque=drive,
                           **{**SPEED, "degrees_of_freedom": 2, **other})


def oscillator(brake, drive=None, te=TE, **other):
    return chain(brake, drive, te, **{**other, "degrees_of_freedom": 1})


# --- The bodies themselves, in SI units -------------------------------------------------------

class Bodies:
    """θ1, θ1', θ2, θ2' ahead of the nominal rotation by DOP853 of SciPy; events by its own search.

    The equations are those of docs/model.md, section 1, the impacts an impulse on each body.
    """

    def __init__(self, drive, brake, *, absolute=False, compliant=False):
        self.torques, self.absolute, self.compliant = (drive, brake), absolute, compliant
        self.ratio = PAIR.gear_ratio
        self.lever = PAIR.pinion_base_lever
        self.damper = 2 * PAIR.xi * math.sqrt(PAIR.equivalent_inertia * PAIR.torsional_stiffness) \
            / self.lever**2
        self.mesh = PAIR.mesh_frequency(**SPEED)

    def flank(self, t):
        """g and its rate at the phase of the nominal rotation."""
        turns = self.mesh * t / (2 * math.pi)
        value, slope = (float(TE.derivative(k, turns % 1.0)) for k in range(2))
        return self.ratio * value, self.ratio * slope * self.mesh / (2 * math.pi)

    def gap(self, t, y):
        """φ and its rate."""
        g, rate = self.flank(t)
        return y[0] - self.ratio * y[2] - g, y[1] - self.ratio * y[3] - rate

    def rates(self, t, y, engaged):
        depth, rate = self.gap(t, y)
        # W = c'·x' + k'·f(x) with x = lever·φ; its lever about the gear is i12 times as long.
        force = self.lever * (self.damper * rate + PAIR.mesh_stiffness * depth) if engaged else 0.0
        turning = self.lever * force
        drive, brake = self.torques
        return [y[1], (drive - turning) / PAIR.pinion_inertia,
                y[3], (self.ratio * turning - brake) / PAIR.gear_inertia]

    def strike(self, t, y):
        """The velocities after the impulse that the law asks for."""
        rate, flank = self.gap(t, y)[1], self.flank(t)[1]
        relative = rate + flank
        wanted = -PAIR.restitution * (relative if self.absolute else rate)
        wanted += 0.0 if self.absolute else flank
        # J1·Δθ1' = -I and J2·Δθ2' = i12·I; θ1' - i12·θ2' becomes what is wanted.
        impulse = (relative - wanted) / (1 / PAIR.pinion_inertia
                                         + self.ratio**2 / PAIR.gear_inertia)
        return [y[0], y[1] - impulse / PAIR.pinion_inertia,
                y[2], y[3] + self.ratio * impulse / PAIR.gear_inertia]

    def follow(self, phi, phi_dot, end):
        """From a flight, the mean rotation nominal, to a time; impacts, contacts and releases.

        phi and phi_dot are rad and rad/s.  Returns times (n,) and θ1, θ1', θ2, θ2' at the end.
        """
        g, slope = self.flank(0.0)
        share = PAIR.gear_inertia / PAIR.total_inertia
        back = (1 - share) / self.ratio
        y = np.outer([share, -back], [phi + g, phi_dot + slope]).ravel()
        t, times, engaged = 0.0, [], False
        while t < end:
            run = self._arc(t, end, y, engaged)
            t, y = run.t[-1] * UNIT, run.y[:, -1]
            if run.status != 1:
                break
            times.append(t)
            if engaged or self.compliant:
                engaged = not engaged
                continue
            y = self.strike(t, y)
            engaged = bool(self.gap(t, y)[1] > 0)
            times += [t] * engaged
        return np.array(times), y

    def _arc(self, t, end, y, engaged):
        """Up to the end, or to where the tooth meets or leaves the drive flank."""
        def touch(s, y):
            return self.gap(s * UNIT, y)[0]
        touch.terminal, touch.direction = True, -1 if engaged else 1
        return solve_ivp(lambda s, y: UNIT * np.array(self.rates(s * UNIT, y, engaged)),
                         (t / UNIT, end / UNIT), y, "DOP853", events=touch, rtol=3e-14, atol=1e-20,
                         max_step=0.2)


@pytest.mark.parametrize("laws, start", [
    ({}, (-3e-5, 1e-5)), ({}, (-1e-4, 0.0)), ({"impact_law": "absolute"}, (-3e-5, 1e-5)),
    ({"contact_law": "compliant"}, (-3e-5, 1e-5))])
def test_both_bodies_integrated_as_such(laws, start):
    """Events and shafts of the engine are those of the bodies.

    Two ways at 3e-14 and 1e-13 a step, some 100 steps a cycle, and motions in which a difference
    grows by less than 100: 1e-11 of the whole is allowed, and found are some 1e-14.
    """
    brake, drive, cycles = 1.8, 1.9, 6
    osc = chain(brake, drive, **laws)
    frequency, end = PAIR.natural_frequency, cycles * osc.period / PAIR.natural_frequency
    times, bodies = Bodies(drive, brake, absolute="impact_law" in laws,
                           compliant="contact_law" in laws).follow(
        start[0], start[1] * frequency, end)
    run = simulate(osc, ("separation", *start), cycles=cycles, rtol=1e-13)
    assert len(times) == len(run.events.tau) >= cycles
    np.testing.assert_allclose(times, run.events.tau / frequency, rtol=0, atol=1e-11 * end)
    g, slope = Bodies(drive, brake).flank(end)
    final = run.final
    angles = osc.mean_rotation.shafts(osc.gear_ratio, final.phi + g, final.mean_angle)
    rates = osc.mean_rotation.shafts(osc.gear_ratio, final.phi_dot + slope / frequency,
                                     final.mean_rate)
    np.testing.assert_allclose(np.array(angles), bodies[::2], rtol=1e-10)
    np.testing.assert_allclose(frequency * np.array(rates), bodies[1::2], rtol=1e-10)


# --- The oscillator of one degree of freedom --------------------------------------------------

def shipped():
    """Operation of every study of every shipped deck that keeps contact by a spring."""
    for path in sorted((ROOT / "inputs").glob("*.nml")):
        deck = load_deck(path)
        for study in deck.responses or (*deck.sweeps, *deck.criticals):
            given = {"brake_torque": 3.0, **deck.operation, **study.operation}
            if study.kind != "response" and study.group == "operation" and study.values is not None:
                given[study.parameter] = float(study.values[0])
            given = {key: value for key, value in given.items() if key != "drive_torque"}
            if given["contact_law"] != "rigid":
                yield pytest.param(deck, given, id=f"{path.stem}-{study.name}")


@pytest.mark.parametrize("deck, operation", list(shipped()))
def test_in_balance_it_is_the_oscillator(deck, operation):
    """The same bits as one degree of freedom by rk4; within 1e-9 rad of its closed form.

    Fifty cycles at rtol 1e-12; the closed form is compared where a difference of 1e-15 grows by
    less than 1e4, as the tangent maps tell.
    """
    two, one = (deck.gear_pair.oscillator(deck.te, **{**operation, "degrees_of_freedom": n})
                for n in (2, 1))
    run = simulate(two, cycles=50, rtol=1e-12)
    taus = np.linspace(0, run.final.tau * (1 - 1e-9), 301)
    phi = run.history(taus).phi
    other = simulate(one, cycles=50, rtol=1e-12, method="rk4")
    assert np.array_equal(phi, other.history(taus).phi)
    assert run.events.drop_vars("kind").equals(other.events.drop_vars("kind"))
    call = TrajectoryCall(one, (-1, 0, 0, 0), numerics=Numerics(), wanted=Wanted(tangent=True))
    maps = CycleMaps.from_rows(call.run((50, 0.0), []).tangent, one.period)
    total, exponent, *_ = multiplied(maps)
    if np.abs(total).max() * 2.0**exponent < 1e4:
        exact = simulate(one, cycles=50, method="exact").history(taus).phi
        assert np.abs(phi - exact).max() < 1e-9


def test_exponents_are_those_of_the_relative_motion():
    """Beside them the mean rotation has multiplier 1 twice: a Jordan block of the period."""
    rows = []
    for osc in (oscillator(1.8, 1.9), chain(1.8, 1.9)):
        call = TrajectoryCall(osc, (-1, 0, 0, 0), numerics=Numerics(method="rk4"),
                              wanted=Wanted(tangent=True))
        rows.append(call.run((30, 0.0), []).tangent)
    one, two = (CycleMaps.from_rows(table, osc.period) for table in rows)
    for name in ("matrix", "exponent", "log_det", "det_sign", "rank", "impacts"):
        assert np.array_equal(getattr(one, name), getattr(two, name)), name
    whole = rows[1]["matrix"]
    assert not whole[:, :2, 2:].any() and not whole[:, 2:, :2].any()
    mean = np.array([[1.0, osc.period], [0.0, 1.0]])
    np.testing.assert_allclose(whole[:, 2:, 2:] * 2.0**rows[1]["exponent"][:, None, None],
                               np.broadcast_to(mean, (30, 2, 2)), rtol=1e-13)


# --- The mean rotation ------------------------------------------------------------------------

def test_the_mean_speed_follows_the_torques_alone():
    """Θ = Θ''·τ²/2 at any time, also inside a summed chatter, to the rounding of its steps."""
    osc = chain(12.0, 9.0)
    run = simulate(osc, cycles=20, rtol=1e-8)
    ends = run.events.tau[run.events.kind == EventKind.CHATTER_END].values
    assert len(ends) > 0
    # The rest of a chatter is summed where it is shorter than 1e-7 of a period.
    inside = np.concatenate([ends - 2e-8 * osc.period, ends - 1e-9 * osc.period])
    taus = np.sort(np.concatenate([np.linspace(0, run.final.tau, 500), inside]))
    history = run.history(taus)
    acceleration = osc.mean_rotation.acceleration
    total = (1.28 * 9.0 - 12.0) / PAIR.total_inertia / PAIR.natural_frequency**2
    assert acceleration == pytest.approx(total, rel=1e-14)
    np.testing.assert_allclose(history.mean_rate, acceleration * taus, rtol=1e-10)
    np.testing.assert_allclose(history.mean_angle, acceleration * taus**2 / 2, rtol=1e-10,
                               atol=1e-25)
    assert run.final.mean_rate == pytest.approx(acceleration * run.final.tau, rel=1e-10)
    begins = run.cycles.cycle.values * osc.period
    np.testing.assert_allclose(run.cycles.mean_rate, acceleration * begins, rtol=1e-10)


def test_going_on_is_bit_for_bit():
    osc = chain(1.8, 1.9)
    whole = simulate(osc, cycles=20).final
    parts = simulate(osc, simulate(osc, cycles=7.3).final, cycles=12.7).final
    assert (whole.phi, whole.phi_dot, whole.mean_angle, whole.mean_rate) == (
        parts.phi, parts.phi_dot, parts.mean_angle, parts.mean_rate)


def test_a_sweep_does_not_depend_on_threads():
    """Each point begins with the nominal rotation, also where its tooth is carried."""
    def run(threads):
        return sweep(PAIR, TE, parameter="drive_torque", values=[1.3, 1.4, 1.5], brake_torque=1.8,
                     settle=5, record=4, observe=("cycles", "exponents"), threads=threads,
                     degrees_of_freedom=2, **SPEED)
    one, two = run(1), run(2)
    assert one.identical(two)
    assert one.attrs["method"] == "rk4"
    taus = (5 + np.arange(4)) * chain(1.8).period
    for drive in (1.3, 1.4, 1.5):
        osc = chain(1.8, drive)
        speed = osc.mean_rotation.mean_speed(osc, osc.mean_rotation.acceleration * taus)
        for start in ("rest", "up", "down"):
            np.testing.assert_allclose(
                one.mean_speed.sel(start=start, drive_torque=drive), speed, rtol=1e-13)


def test_a_response_tells_both_shafts():
    """Momentum of the shafts and their relative speed, from the stored columns."""
    osc = chain(1.8, 1.9)
    data = response(osc, PAIR, name="one", settle=10, record=5)
    ratio = PAIR.gear_ratio
    nominal = 1500 * math.pi / 30
    momentum = (ratio * PAIR.pinion_inertia * (data.pinion_speed - nominal)
                + PAIR.gear_inertia * (data.gear_speed - nominal / ratio))
    since = data.time + 10 * data.attrs["mesh_period_s"]
    np.testing.assert_allclose(momentum, (ratio * 1.9 - 1.8) * since, rtol=1e-9)
    np.testing.assert_allclose(data.pinion_angle - ratio * data.gear_angle, data.dynamic_te,
                               rtol=0, atol=1e-15)
    np.testing.assert_allclose(
        data.cycle_mean_speed, data.attrs["mean_speed_first"]
        + data.attrs["mean_acceleration"] * data.attrs["mesh_period_s"] * np.arange(5), rtol=1e-12)


@pytest.mark.parametrize("drive", [None, 1.9])
def test_the_figure_shows_both_shafts(drive):
    """The mean speed as stored, up to the record's end; each shaft about its share of it."""
    osc = chain(1.8, drive)
    data = response(osc, PAIR, name="one", settle=10, record=5)
    mean, pinion, gear = shaft_motion.draw(data, {"gear_ratio": PAIR.gear_ratio}).axes
    speeds = mean.lines[0].get_ydata()
    np.testing.assert_array_equal(speeds[:-1], data.cycle_mean_speed)
    gained = 0.0 if drive is None else (PAIR.gear_ratio * drive - 1.8) * PAIR.gear_ratio \
        / PAIR.total_inertia * data.attrs["mesh_period_s"] * 5
    assert speeds[-1] - speeds[0] == pytest.approx(gained, rel=1e-9, abs=1e-12)
    # The momenta about the mean cancel: i12·J1·Δ1 + J2·Δ2 = 0.
    above = [axis.lines[0].get_ydata() for axis in (pinion, gear)]
    weighted = PAIR.gear_ratio * PAIR.pinion_inertia * above[0], PAIR.gear_inertia * above[1]
    np.testing.assert_allclose(*(weighted[0], -weighted[1]), rtol=0,
                               atol=1e-7 * np.abs(weighted[0]).max())
    assert [axis.get_ylabel() for axis in (mean, pinion, gear)] == [
        "pinion (rad/s)", "pinion (mrad/s)", "gear (mrad/s)"]
    assert np.ptp(above[0]) > 100


# --- What is refused --------------------------------------------------------------------------

def test_rigid_contact_is_refused():
    with pytest.raises(ParameterError, match="degrees_of_freedom = 2 goes with contact_law"):
        chain(1.8, contact_law="rigid")


@pytest.mark.parametrize("number", [0, 3, 1.5, "2", True])
def test_other_numbers_of_degrees_are_refused(number):
    with pytest.raises(ParameterError, match="degrees_of_freedom"):
        chain(1.8, degrees_of_freedom=number)


def test_the_closed_form_is_refused():
    with pytest.raises(ValueError, match="method = 'exact' goes with degrees_of_freedom = 1"):
        simulate(chain(1.8), method="exact")
    assert simulate(chain(1.8), cycles=1).method == "rk4"
