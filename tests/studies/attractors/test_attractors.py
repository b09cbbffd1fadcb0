"""Attractors and their shares: recognised early, as long runs, closed forms and statistics say."""

import numpy as np
import pytest

import lapwing
from helpers import FLAT, one_impact_orbits, oscillator, scene_a, scene_c, scene_d
from lapwing import Ending, MotionState, Numerics, Status, attractors, engine, find_orbit
from lapwing.engine import Known, calls
from lapwing.studies.attractors.motions import Motion, goals_of
from lapwing.studies.attractors.search import Search
from lapwing.studies.attractors.starts import ranges

NUMERICS = Numerics(rtol=1e-8)


@pytest.fixture(scope="module")
def c18():
    """Scene C at 1.8 N·m: three one-impact motions beside each other, 4096 random starts."""
    return attractors(scene_c(1.8), "random", runs=4096, seed=1)


@pytest.fixture(scope="module")
def known_c18():
    """A search that knows them, for starts of a test's own."""
    osc = scene_c(1.8)
    search = Search(osc, NUMERICS, 1000, 30, 50, 64, 1)
    states = [(float(MotionState.SEPARATION), *state[:2], 0.0) for n in (1, 2, 3)
              for state in one_impact_orbits(osc, n) if abs(state[2]) < 1 + osc.restitution**2]
    assert search.look_at(np.array(states)).tolist() == [1, 2, 3]
    return search


def test_attractors_are_those_of_the_closed_form(c18):
    osc = scene_c(1.8)
    assert c18.period.values.tolist() == [1, 2, 3]
    assert c18.arrivals.values.tolist() == [1, 1, 1]
    assert (c18.unresolved, c18.failed) == (0, 0)
    for i, n in enumerate((1, 2, 3)):
        (phi, phi_dot, _), = (one for one in one_impact_orbits(osc, n)
                              if abs(one[2]) < 1 + osc.restitution**2)
        points = c18.isel(attractor=i)
        miss = np.hypot(points.point_phi - phi, points.point_phi_dot - phi_dot)
        # Newton ends at 1e-10 of a size of some 1e-4 rad at the latest.
        assert np.nanmin(miss) < 1e-14
        assert int(np.isfinite(points.point_phi).sum()) == n
        # A complex pair has the modulus ε, its exponent is ln ε/(nP).
        assert np.hypot(points.multiplier_real, points.multiplier_imag).values \
            == pytest.approx(osc.restitution, rel=1e-9)
        assert float(points.lyapunov_exponent) == pytest.approx(
            np.log(osc.restitution) / (n * osc.period), rel=1e-9)


@pytest.mark.parametrize("build", [lambda: scene_c(1.8), lambda: scene_a(12.4),
                                   lambda: scene_a(5.5, "relative"), lambda: scene_c(4.5)])
def test_a_run_ends_where_a_long_run_ends(build):
    """The attractor of 24 starts against 1500 mesh cycles of each, which stop early nowhere."""
    osc = build()
    found = attractors(osc, "random", runs=24, seed=5)
    rows = np.column_stack([found[f"start_{name}"] for name in (
        "motion_state", "phi", "phi_dot", "phase")])
    whole = engine.sweep([osc] * 24, [(i, i, False) for i in range(24)], rows, numerics=NUMERICS,
                         wanted=engine.Wanted(cycles=True, bounces=False), settle=1400, record=100,
                         log_room=1, threads=1)
    assert np.all(whole.outcome["status"] == Status.OK)
    for row, end in zip(found.attractor_of_run.values, whole.outcome, strict=True):
        motion = found.sel(attractor=row)
        assert motion.period == end["period"]
        if end["period"] == 0:
            continue
        near = np.hypot(motion.point_phi - end["phi"], motion.point_phi_dot - end["phi_dot"])
        assert near.min() < 1e-7 * max(abs(osc.force), float(motion.deepest_separation))


def test_kinds_of_ends():
    """Aperiodic, complete chatter, at rest on a rigid flank, a standing coast flank."""
    chaos = attractors(scene_d(2.0), "sobol", runs=256, resolution=128)
    assert chaos.period.values.tolist() == [0]
    assert chaos.ending.values.tolist() == [Ending.PRESUMED] * 256
    assert float(chaos.lyapunov_exponent[0]) > 3 * float(chaos.lyapunov_exponent_error[0]) > 0
    assert chaos.point.size == 2048 and chaos.cell_phi > 0
    chatter = attractors(scene_a(5.5, "relative"), "sobol", runs=256)
    assert (chatter.period.item(), chatter.chatter.item()) == (1, 1)
    assert chatter.motion_class.item() == f"1:({chatter.arrivals.item()},0)c"
    # Complete chatter leaves one number of two.
    assert chatter.multiplier_real.values[0, 1] == 0
    rigid = attractors(scene_a(1000.0, "relative", contact_law="rigid"), "sobol", runs=256)
    assert rigid.point_phi.values.tolist() == [[0.0]]
    assert rigid.deepest_separation.item() == 0
    standing = attractors(scene_a(0.2, "relative", back_flank_te=False), "sobol", runs=256)
    assert standing.back_arrivals.values.tolist() == [1]
    for one in (chatter, rigid, standing):
        assert one.ending.values.tolist() == [Ending.CERTAIN] * 256


def test_it_is_not_guessed_where_a_run_ends():
    """Given up after so few mesh cycles that nothing can be known, a run is unresolved."""
    osc = scene_c(1.8)
    search = Search(osc, NUMERICS, 3, 30, 50, 64, 1)
    search.look_at(np.array([[0.0, -1e-4, 0.0, 0.0]]))
    assert len(search.motions) == 1
    ends = search.follow(np.array([[0.0, -1e-3, 0.0, 0.0], [0.0, -5e-4, 1e-5, 0.3]]))
    assert ends["motion"].tolist() == [0, 0] and ends["ending"].tolist() == [0, 0]
    assert ends["cycles"].tolist() == [3, 3]
    failing = Numerics(rtol=1e-8, max_events_per_cycle=1)
    found = attractors(scene_a(3.3), "grid", runs=16, numerics=failing)
    assert found.attrs["failed"] == 16 and found.attractor.size == 0
    assert set(found.status.values) == {Status.TOO_MANY_EVENTS}


def test_a_presumed_end_wants_returns_each_of_which_is_nearer(known_c18):
    """Without a certain ellipse the same starts end in the same motions, later and presumed."""
    from dataclasses import replace

    known = known_c18.known()
    goals = known.goals.copy()
    goals["certain"] = -1
    rows = np.array([[0.0, x, 0.0, 0.0] for x in np.linspace(-1.9e-3, -1e-5, 40)])
    sure = engine.destinations(known_c18.osc, known, rows, numerics=NUMERICS)
    less = engine.destinations(known_c18.osc, replace(known, goals=goals), rows, numerics=NUMERICS)
    assert set(sure["ending"]) == {Ending.CERTAIN} and set(less["ending"]) == {Ending.PRESUMED}
    assert np.array_equal(sure["motion"], less["motion"])
    assert np.all(less["cycles"] > sure["cycles"])
    assert np.all(less["cycles"] >= 30 * np.array([0, 1, 2, 3])[less["motion"].astype(int)])


def test_whoever_enters_a_certain_ellipse_stays(known_c18):
    """States on its rim, none of which was tried, are nearer in its own norm at every return."""
    osc = known_c18.osc
    for motion, goals in zip(known_c18.motions, known_c18._goals, strict=True):
        for goal in goals:
            metric = np.array([[goal["s11"], goal["s12"]], [goal["s12"], goal["s22"]]])
            rim = np.linalg.solve(np.linalg.cholesky(metric).T, np.sqrt(goal["certain"]) * np.array(
                [np.cos(np.linspace(0.1, 6.3, 23)), np.sin(np.linspace(0.1, 6.3, 23))])).T
            x = rim + np.array([goal["phi"], goal["phi_dot"]])
            last = np.full(len(x), goal["certain"])
            for _ in range(5):
                rows = np.column_stack([np.zeros(len(x)), x, np.zeros(len(x))])
                end = engine.sweep([osc] * len(x), [(i, i, False) for i in range(len(x))], rows,
                                   numerics=NUMERICS, wanted=engine.Wanted(), settle=0,
                                   record=motion.period, log_room=1, threads=1).outcome
                x = np.column_stack([end["phi"], end["phi_dot"]])
                away = x - [goal["phi"], goal["phi_dot"]]
                now = np.einsum("ni,ij,nj->n", away, metric, away)
                assert np.all(now < last)
                last = now


def test_an_unstable_motion_has_no_certain_end():
    osc = scene_c(1.8)
    saddle = next(one for one in one_impact_orbits(osc, 2) if one[2] > 1 + osc.restitution**2)
    orbit = find_orbit(osc, (MotionState.SEPARATION, *saddle[:2]), 2)
    motion = Motion(2, np.array([[0.0, *saddle[:2]]] * 2), 1e-4, None, orbit.multipliers.values,
                    0.0, maps=orbit.maps)
    assert motion.lost
    assert goals_of(osc, motion, 1)["certain"].tolist() == [-1, -1]


@pytest.mark.parametrize("n", [2, 3])
def test_the_boundary_is_the_stable_manifold_of_the_saddle(known_c18, n):
    """Across the saddle's stable direction, at a distance a of it, the label changes where the
    manifold is, which leaves its tangent by a² at first."""
    osc = known_c18.osc
    phi, phi_dot, _ = next(one for one in one_impact_orbits(osc, n)
                           if one[2] > 1 + osc.restitution**2)
    orbit = find_orbit(osc, (MotionState.SEPARATION, phi, phi_dot), n)
    assert orbit.state[1:] == pytest.approx((phi, phi_dot), abs=1e-14)
    total = np.eye(2)
    for matrix, exponent in zip(orbit.maps.matrix, orbit.maps.exponent, strict=True):
        total = np.ldexp(matrix, int(exponent)) @ total
    values, vectors = np.linalg.eig(total)
    order = np.argsort(np.abs(values))
    stable, unstable = (vectors[:, k].real * orbit.size for k in order)

    def labels(along, across):
        rows = np.array([(0.0, *([phi, phi_dot] + a * stable + t * unstable), 0.0)
                         for a, t in zip(along, across, strict=True)])
        return engine.destinations(osc, known_c18.known(), rows, numerics=NUMERICS)["motion"]

    along = 0.0005 * np.array([1, -1, 0.5, -0.5])
    low, high = np.full(4, -1e-4), np.full(4, 1e-4)
    sides = labels(along, low), labels(along, high)
    assert n in (set(sides[0]) | set(sides[1]))
    assert np.all(sides[0] == sides[0][0]) and np.all(sides[1] == sides[1][0])
    assert sides[0][0] != sides[1][0]
    for _ in range(32):
        middle = (low + high) / 2
        below = labels(along, middle) == sides[0]
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    # t = c a² + d a³ + e a⁴: the mean of both sides is c a², a quarter of it at half the distance;
    # e a² is below 1 % of c here.
    far, near = (low[0] + low[1]) / 2, (low[2] + low[3]) / 2
    assert abs(far) < 10 * 0.0005**2
    assert near == pytest.approx(far / 4, rel=0.02)


def test_shares_of_two_seeds_agree(c18):
    """Within 99.9 %: the difference of two shares of 4096 is normal; three of them are compared."""
    other = attractors(scene_c(1.8), "random", runs=4096, seed=2)
    assert np.allclose(other.point_phi, c18.point_phi, atol=1e-14, equal_nan=True)
    both = (c18.share + other.share) / 2
    z = (c18.share - other.share) / np.sqrt(2 * both * (1 - both) / 4096)
    assert np.all(np.abs(z) < 3.6)  # 0.001/3, two-sided
    # Sobol draws are of the same shares: their own intervals, and those of the random ones.
    sobol = attractors(scene_c(1.8), "sobol", runs=4096, seed=1)
    assert np.all((sobol.share_low < c18.share_high) & (c18.share_low < sobol.share_high))


def test_intervals_hold_the_truth(known_c18):
    """Of 200 studies of 128 random starts, against 30,000 starts: the 95 % intervals of
    Clopper-Pearson hold it at least in 95 of 100 cases, less chance."""
    from lapwing.studies.attractors.dataset import shares
    from lapwing.studies.ensemble.statistics import Sample

    osc, rng = known_c18.osc, np.random.default_rng(7)
    low, high = np.array(list(ranges(osc, 0.0).values())).T

    def labels(count):
        x = low + rng.random((count, 2)) * (high - low)
        rows = np.column_stack([(x[:, 0] > 0).astype(float), x, np.zeros(count)])
        return known_c18.follow(rows)["motion"]

    whole = labels(30_000)
    truth = np.array([np.mean(whole == n) for n in (1, 2, 3)])
    held = np.zeros(3)
    for part in np.split(labels(200 * 128), 200):
        told = shares(part, part > 0, 3, Sample(128, 0))
        held += (told["share_low"][1] <= truth) & (truth <= told["share_high"][1])
    # 95 % of 200 is 190; 181 is three standard deviations below.
    assert np.all(held >= 181)


def test_unresolved_runs_widen_the_interval():
    from lapwing.studies.attractors.dataset import shares
    from lapwing.studies.ensemble.statistics import Sample

    labels = np.array([1] * 30 + [2] * 50 + [0] * 20)
    told = shares(labels, labels > 0, 2, Sample(100, 0))
    sure = shares(np.array([1] * 30 + [2] * 70), np.ones(100, bool), 2, Sample(100, 0))
    assert told["share"][1].tolist() == [30 / 80, 50 / 80]
    assert told["share_low"][1][0] == sure["share_low"][1][0]
    assert told["share_high"][1][1] == sure["share_high"][1][1]
    assert told["share_high"][1][0] > 0.5


def test_no_byte_depends_on_threads_or_pauses(monkeypatch):
    """Chaos with chatter beside a periodic motion, each call of the engine cut after 128 arcs."""
    osc = scene_c(4.5)
    one = attractors(osc, "sobol", runs=256, threads=1)
    assert attractors(osc, "sobol", runs=256, threads=3).identical(one)
    search = Search(osc, NUMERICS, 1000, 30, 50, 256, 1)
    rows = np.column_stack([one[f"start_{name}"] for name in (
        "motion_state", "phi", "phi_dot", "phase")])
    search.find(rows)
    whole, calls_made = search.follow(rows[:64]), []
    monkeypatch.setattr(calls, "CALL_SECONDS", 0.0)
    cut = engine.destinations(osc, search.known(), rows[:64], numerics=NUMERICS,
                              told=calls_made.append)
    assert len(calls_made) > 100
    assert cut.tobytes() == whole.tobytes()


def test_starts_are_spread_as_they_say():
    osc = scene_a(12.0)
    grid = attractors(osc, "grid", runs=36, phi=(-1e-4, 1e-4), phi_dot=(-2e-5, 0), phase=0.25)
    assert sorted(set(np.round(grid.start_phi.values * 6e4).astype(int))) == [-5, -3, -1, 1, 3, 5]
    assert grid.start_phi_dot.min() == pytest.approx(-2e-5 * 11 / 12)
    assert set(grid.start_phase.values) == {0.25}
    assert np.array_equal(grid.start_motion_state == MotionState.ENGAGEMENT, grid.start_phi > 0)
    assert np.all(np.isnan(grid.share_low)) and float(grid.share.sum()) == 1
    listed = attractors(osc, [[-1e-4, 0, 0.5], [1e-5, 0, 0.0]])
    assert listed.start_phase.values.tolist() == [0.5, 0.0]
    assert listed.starts == "listed"


def test_what_is_refused():
    osc = scene_a(12.0)
    for given, message in (
            ({"starts": "x"}, "'sobol', 'random', 'grid'"),
            ({"runs": 1000}, "a power of two in each of 16 scrambles"),
            ({"starts": "grid", "runs": 5}, "a square number"),
            ({"starts": [[0, 0, 2]]}, "mesh phases from 0 to below 1"),
            ({"starts": [[0, 0]], "phi": (0, 1)}, "phi goes with starts that are drawn"),
            ({"phi": (1, 0)}, "low below high"),
            ({"most_cycles": 0, "resolution": 3}, "most_cycles.*resolution"),
            ({"numerics": 3, "progress": 3, "phase": 1.0}, "phase.*numerics.*progress")):
        with pytest.raises(ValueError, match=message):
            attractors(osc, **given)
    with pytest.raises(ValueError, match="lets no tooth into a flank"):
        attractors(scene_a(12.0, "relative", contact_law="rigid"), [[1e-5, 0.0]])
    with pytest.raises(ValueError, match="degrees_of_freedom = 2"):
        attractors(scene_a(12.0, "relative", degrees_of_freedom=2))
    with pytest.raises(ValueError, match="osc = 3"):
        attractors(3)


def test_a_gap_that_is_not_moved_ends_in_contact():
    """No transmission error: every start comes to rest on the drive flank."""
    found = lapwing.attractors(oscillator(FLAT, force=1.0, period=20.0, backlash=3.0,
                                          damping_ratio=0.2), "random", runs=50)
    assert found.period.values.tolist() == [1]
    assert found.point_phi.item() == pytest.approx(1.0, abs=1e-10)
    assert found.share.values.tolist() == [1.0] and found.share_low.item() < 1
    assert Known().most_cycles == 1000


@pytest.mark.filterwarnings("error")
def test_motions_that_lose_nothing_are_no_attractors():
    """Elastic and undamped: what repeats has multipliers of modulus one, and attracts nothing."""
    osc = oscillator(lapwing.TransmissionError.harmonic([1.0]), force=1.0, period=2 * np.pi,
                     restitution=1.0, backlash=1e3, gap="one_flank", contact_law="rigid")
    found = attractors(osc, [[-2.0, 0.5], [-3.0, 0.0], [-1.0, 1.0]], most_cycles=20, threads=1)
    assert not np.any(found.period > 0)
    assert np.all(found.ending != Ending.CERTAIN)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("fast", [1e10, 1e70])
def test_a_flight_that_outlasts_the_record_is_no_attractor(fast):
    """Nothing comes back within the cycles that are looked at, and no number overflows."""
    found = attractors(scene_c(1.8, gap="one_flank"), [[-1e-4, -fast]], threads=1)
    assert (found.attractor.size, found.unresolved) == (0, 1)
