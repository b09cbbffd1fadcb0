"""The hard cases: what is hard about each, and where possible its outcome by hand.

Every function returns what it is, the scene (over DEFAULTS), start, start phase, cycles, options:
`closed` {(kind, n-th of it, column): number by hand}, `kinds` the first event kinds by hand, `by`
in words, `coincidence` where events meet exactly. Numbers are doubles, taken as they are.
"""

from make_hard_cases import (
    SCENE_A,
    SMOOTH,
    THREE_ARCS,
    TRIANGLE,
    case,
    parabola,
    scaled,
)
from mpmath import mp, mpf

GAP = {"backlash": 1.0}


# --- touches ------------------------------------------------------------------------------------


def launch(overlap):
    """A launch from the drive flank that overlaps the coast flank by so much."""
    return float(mp.sqrt(2 * (1 + mpf(overlap))))


@case
def graze_coast_hit():
    v = launch("1e-9")
    slow = mp.sqrt(mpf(v) ** 2 - 2)
    return ("coast flank overlapped by 1e-9 of the backlash", GAP, ("separation", 0.0, -v), 0.0, 1,
            {"closed": {("BACK_IMPACT", 0, "tau"): v - slow,
                        ("BACK_IMPACT", 0, "velocity_before"): -slow}, "by": "√(v² - 2Fθ0)"})


@case
def graze_coast_missed():
    v = launch("-1e-9")
    return ("coast flank missed by 1e-9 of the backlash", GAP, ("separation", 0.0, -v), 0.0, 1,
            {"closed": {("IMPACT", 0, "tau"): 2 * mpf(v)}, "kinds": ["IMPACT"], "by": "2v/F"})


def withdrawing(overlap):
    """A flank with g'' = 2F turns away in front of the tooth."""
    v = float(mp.sqrt(2 * (1 + mpf(overlap))))
    return {"te": parabola(128.0)}, ("separation", -1.0, v), 0.125, 1


@case
def graze_drive_hit():
    scene = withdrawing("1e-9")
    v = mpf(scene[1][2])
    slow = mp.sqrt(v * v - 2)
    return ("drive flank with g'' = 2F overlapped by 1e-9", *scene,
            {"closed": {("IMPACT", 0, "tau"): v - slow, ("IMPACT", 0, "velocity_before"): slow},
             "by": "φ'' = -F exactly"})


@case
def graze_drive_missed():
    scene = withdrawing("-1e-9")
    return ("drive flank with g'' = 2F missed by 1e-9", *scene,
            {"kinds": ["KINK"], "by": "no contact, φ(s) = -1 + vs - s²/2"})


UNDAMPED = {"contact_law": "compliant", "damping_ratio": 0.0, "restitution": 1.0}


@case
def graze_release():
    start = 2.0 + 1e-9
    at = mp.acos(-1 / (mpf(start) - 1))
    return ("contact that overlaps release by 1e-9 of its deflection", UNDAMPED,
            ("engagement", start, 0.0), 0.0, 1,
            {"closed": {("RELEASE", 0, "tau"): at}, "by": "φ = F + (φ0 - F) cos τ"})


@case
def graze_no_release():
    start = 2.0 - 1e-9
    return ("contact that misses release by 1e-9 of its deflection", UNDAMPED,
            ("engagement", start, 0.0), 0.0, 1,
            {"closed": {("final", 0, "phi"): 1 + (mpf(start) - 1) * mp.cos(8)}, "kinds": [],
             "by": "φ = F + (φ0 - F) cos τ"})


# --- chatter ------------------------------------------------------------------------------------


@case
def chatter_three_times_a_cycle():
    # Thrown off at the kink after 3/8 with Δg' = 2.75/8, pressed with F - g'' = 1 + 8/64.
    end = 3 + 2 * mpf("2.75") / 8 / (mpf("1.125") * mpf("0.75"))
    return ("a chatter after each of three kinks", {"te": THREE_ARCS, "contact_law": "rigid",
                                                    "restitution": 0.25}, "rest", 0.0, 2,
            {"closed": {("CHATTER_END", 0, "tau"): end}, "kinds": ["KINK", "RELEASE", "IMPACT"],
             "by": "2v/(a(1-ε)) after the kink"})


@case
def chatter_on_the_coast_flank():
    end = 3 + 2 * mpf("2.75") / 8 / (mpf("1.125") * mpf("0.75"))
    return ("the same at the coast flank, mirrored", {
        "te": scaled(THREE_ARCS, -1.0), "contact_law": "rigid", "restitution": 0.25, "force": -1.0,
        **GAP}, "rest", 0.0, 2,
            {"closed": {("BACK_CHATTER_END", 0, "tau"): end}, "by": "2v/(a(1-ε)) after the kink"})


@case
def chatter_with_contact_between():
    return ("chatter, damped contact and release in turn, three kinks a cycle",
            {"te": scaled(THREE_ARCS, 4.0), "force": 0.5, "restitution": 0.25}, "rest", 0.0, 2)


# F - g'' is 1 up to 3/8 of the cycle, then -1: a drop from h = 1/2 at ε = 1/2 comes to rest after
# √(2h)·3 = 3, which is that instant.
TURN = [[0.0, 0.0, 6.0, 6.0], [0.375, 0.0, -6.0, -6.0], [0.5, 0.0, 6.0, 6.0]]


def drop_before_turn(law, height):
    return {"te": TURN, "contact_law": law, "force": 0.5}, ("separation", -height, 0.0), 0.0, 1


@case
def chatter_ends_just_before_release():
    scene = drop_before_turn("rigid", 0.5 * (1 - 2e-9))
    end = 3 * mp.sqrt(2 * mpf(scene[1][1]) / -1)
    return ("a chatter that ends 3e-9 before the load turns", *scene,
            {"closed": {("CHATTER_END", 0, "tau"): end, ("RELEASE", 0, "tau"): mpf(3)},
             "by": "√(2h/F)(1+ε)/(1-ε)"})


@case
def chatter_ends_just_before_release_from_contact():
    scene = drop_before_turn("restitution", 0.5 * (1 - 2e-9))
    end = 3 * mp.sqrt(2 * mpf(scene[1][1]) / -1)
    return ("the same with a damped contact in between", *scene,
            {"closed": {("CHATTER_END", 0, "tau"): end}, "by": "√(2h/F)(1+ε)/(1-ε)"})


@case
def chatter_undone_by_release():
    scene = drop_before_turn("rigid", 0.5 * (1 + 2e-9))
    fall = mp.sqrt(-2 * mpf(scene[1][1]))
    return ("a chatter whose end would come 3e-9 after the load turns: it never ends", *scene,
            {"closed": {("IMPACT", n, "tau"): fall * (3 - mpf(2) ** (1 - n)) for n in range(20)},
             "kinds": ["IMPACT"] * 20, "by": "geometric series up to there"})


@case
def chatter_ends_at_release():
    return ("a chatter that ends at the instant of release", *drop_before_turn("rigid", 0.5),
            {"coincidence": True, "closed": {("RELEASE", 0, "tau"): mpf(3),
                                             ("CHATTER_END", 0, "tau"): mpf(3)},
             "by": "√(2h/F)(1+ε)/(1-ε) = 3, where F - g'' changes sign"})


@case
def chatter_on_a_standing_flank():
    return ("chatter at a coast flank that stands still, under a moving drive flank",
            {"te": SMOOTH, "back_flank_te": False, "force": -1.0, "backlash": 4.0},
            ("separation", -2.0, 0.0), 0.25, 2,
            {"kinds": ["BACK_IMPACT"] * 5})


@case
def chatter_under_jerk():
    return ("chatter while the load changes linearly", {"te": SMOOTH, "force": 0.25},
            ("separation", -0.0625, 0.0), 0.25, 2)


@case
def absolute_impacts_pile_up():
    return ("rebounds by the absolute law die out where g' passes zero, at a crest",
            {"te": parabola(-6.4), "impact_law": "absolute", "restitution": 0.2},
            ("separation", -0.125, 0.0), 0.0, 1,
            {"coincidence": True, "closed": {("CHATTER_END", 0, "tau"): mpf(4)},
             "by": "self-similar bounces accumulate where g' = 0, at the crest"})


@case
def absolute_impacts_over_a_crest():
    return ("rebounds by the absolute law that outlast the crest: one goes on into the flank",
            {"te": parabola(-6.4), "impact_law": "absolute", "restitution": 0.8},
            ("separation", -0.125, 0.0), 0.0, 1)


@case
def absolute_with_both_flanks():
    return ("the absolute law between two moving flanks",
            {"te": SMOOTH, "impact_law": "absolute", "restitution": 0.8, "force": 0.05,
             "backlash": 0.5}, ("separation", -0.25, 0.5), 0.25, 2)


# --- ends of ranges -----------------------------------------------------------------------------


@case
def no_restitution():
    return ("ε = 0 on a smooth flank", {"te": scaled(SMOOTH, 4.0), "restitution": 0.0,
                                        "force": 0.5}, "rest", 0.0, 3)


@case
def full_restitution():
    start = ("separation", -0.5, 1.0)
    f, energy = mpf(0.5), mpf(0.75)
    front, back = mp.sqrt(2 * energy), mp.sqrt(2 * (energy - f))
    first = (front - 1) / f
    half = (front - back) / f
    return ("ε = 1 between two flanks at rest, 25 cycles",
            {"restitution": 1.0, "force": 0.5, **GAP, "damping_ratio": 0.0}, start, 0.0, 25,
            {"closed": {("IMPACT", n, "tau"): first + 2 * n * half for n in (0, 1, 50, 90)}
             | {("BACK_IMPACT", n, "tau"): first + (2 * n + 1) * half for n in (0, 90)},
             "by": "period 2(v_f - v_b)/F"})


def damping(ratio):
    return (f"damping ratio {ratio!r}", {
        "te": scaled(SMOOTH, 4.0), "contact_law": "compliant", "damping_ratio": ratio,
        "force": 0.125, "backlash": 0.25}, "rest", 0.0, 3)


@case
def undamped():
    return damping(0.0)


@case
def critically_damped():
    return damping(1.0)


@case
def almost_critically_damped():
    return damping(1 - 1e-8)


@case
def overdamped():
    return damping(1.3)


@case
def hardly_damped():
    return damping(1e-9)


PUBLISHED = {"te": scaled(SCENE_A, 1.28), "force": 7.148115185e-6, "period": 83.046905,
             "restitution": 0.8, "backlash": 0.002}


@case
def tiny_backlash():
    return ("backlash of 1e-9 rad under a flank motion of 4e-4 rad",
            {**PUBLISHED, "backlash": 1e-9}, "rest", 0.0, 1)


@case
def tiny_backlash_compliant():
    return ("the same with compliant contact",
            {**PUBLISHED, "backlash": 1e-9, "contact_law": "compliant"}, "rest", 0.0, 1)


STIFF = {**PUBLISHED, "force": 7.148115185e-10, "period": 8304.6905}


@case
def stiff_mesh():
    return ("mesh stiffness times 1e4: a mesh period of 8300 units of τ", STIFF, "rest", 0.0, 1)


@case
def stiff_mesh_compliant():
    return ("the same with compliant contact", {**STIFF, "contact_law": "compliant"}, "rest",
            0.0, 1)


@case
def stiff_mesh_absolute():
    return ("the same with the absolute impact law", {**STIFF, "impact_law": "absolute"}, "rest",
            0.0, 2)


def engaged_response(bend, period, xi):
    """Least load of complete engagement on the kinked parabola and the response at its kink.

    g'' = bend/P² but for a slope jump of -bend/P at phase 0; the response to the row of impulses
    is a geometric series. Returns F_crit, φ(0+) - F, φ'(0+), s of the minimum.
    """
    bend, period, xi = mpf(bend), mpf(period), mpf(xi)
    omega = mp.sqrt(1 - xi * xi)
    rate = mp.mpc(-xi, omega)
    series = 1 / (1 - mp.exp(rate * period))

    def h(s, order=0):
        return bend / period / omega * mp.im(rate**order * mp.exp(rate * s) * series)
    at = [(m * mp.pi - mp.arg(rate * series)) / omega for m in range(-2, 40)]
    best = min([mpf(0), *[s for s in at if 0 <= s < period]], key=h)
    steady = -bend / period**2
    return -steady - h(best), steady + h(mpf(0)), h(mpf(0), 1), best


def near_critical(side, law):
    critical, offset, rate, _ = engaged_response(-8.0, 26.0, 0.1)
    force = float(critical * (1 + mpf(side)))
    return ({"te": parabola(-8.0), "force": force, "period": 26.0, "contact_law": law},
            ("engagement", float(mpf(force) + offset), float(rate)), 0.0, 3)


@case
def above_critical_torque():
    return ("1e-6 above the least torque of complete engagement, on the periodic response",
            *near_critical("1e-6", "restitution"), {"kinds": ["KINK"] * 3,
                                                    "by": "contact is never lost"})


@case
def below_critical_torque():
    return ("1e-6 below the least torque of complete engagement, on the periodic response",
            *near_critical("-1e-6", "restitution"), {"kinds": ["RELEASE"], "by": "contact is lost"})


@case
def below_critical_torque_compliant():
    return ("the same with compliant contact", *near_critical("-1e-6", "compliant"),
            {"kinds": ["RELEASE", "ENGAGE"], "by": "contact is lost"})


# g'' = -7/64 + 12/64 w, then from phase 1/2 on 7/64 - 12/64 (w - 1/2): greatest right after ½.
TWO_BENDS = [[0.0, 0.0, 1.0, 1.0], [0.5, -0.125, -1.0, -1.0]]


def load_against_bend(side):
    """Rigid contact that the load just holds, or just not, where g'' jumps to its greatest."""
    force = float(mpf(7) / 64 * (1 + mpf(side)))
    return {"te": TWO_BENDS, "force": force, "contact_law": "rigid"}, "rest", 0.0, 2


@case
def rigid_above_the_load_that_holds():
    return ("rigid contact with F 1e-6 above the greatest g''", *load_against_bend("1e-6"),
            {"kinds": [], "by": "F - g'' > 0 throughout"})


@case
def rigid_below_the_load_that_holds():
    return ("rigid contact with F 1e-6 below the greatest g'', which it jumps to at a knot",
            *load_against_bend("-1e-6"),
            {"closed": {("RELEASE", 0, "tau"): mpf(4)}, "kinds": ["RELEASE"],
             "by": "g'' jumps above F at phase ½"})


# --- kinks --------------------------------------------------------------------------------------


def arrival_on_a_kink(early):
    return ({"te": TRIANGLE, "force": 2.0, "period": 2.0}, ("separation", -0.75 + early, -0.25),
            0.0, 1)


@case
def impact_on_a_kink():
    return ("kink and impact at one instant", *arrival_on_a_kink(0.0),
            {"coincidence": True, "kinds": ["KINK", "IMPACT"],
             "closed": {("IMPACT", 0, "tau"): mpf(1),
                        ("IMPACT", 0, "velocity_before"): mpf("2.25")},
             "by": "θ = -3/4 + s² meets g = 1/4 at s = 1; the kink comes first"})


@case
def impact_just_before_a_kink():
    scene = arrival_on_a_kink(1.75e-9)
    e = mpf(scene[1][1]) + mpf("0.75")
    return ("an impact 1e-9 before a kink", *scene,
            {"kinds": ["IMPACT", "KINK"],
             "closed": {("IMPACT", 0, "tau"): (0.25 + mp.sqrt(mpf("3.0625") - 4 * e)) / 2},
             "by": "s² - s/4 - 3/4 + e = 0"})


@case
def impact_just_after_a_kink():
    scene = arrival_on_a_kink(-1.75e-9)
    e = mpf(scene[1][1]) + mpf("0.75")
    return ("an impact 1e-9 after a kink", *scene,
            {"kinds": ["KINK", "IMPACT"],
             "closed": {("IMPACT", 0, "tau"): (-0.25 + mp.sqrt(mpf("5.0625") - 4 * e)) / 2},
             "by": "s² + s/4 - 5/4 + e = 0"})


@case
def kink_turns_the_tooth_back():
    return ("a kink that reverses the tooth's relative velocity in the gap",
            {"te": TRIANGLE, "force": 0.0625, "period": 2.0}, ("separation", -0.0625, -0.25),
            0.0, 1, {"kinds": ["KINK", "IMPACT"],
                     "closed": {("KINK", 0, "velocity_before"): mpf("-0.1875"),
                                ("KINK", 0, "velocity_after"): mpf("0.3125")},
                     "by": "φ'₊ = φ'₋ - Δg', Δg' = -1/2"})


@case
def kink_while_in_contact():
    return ("kinks under a compliant contact, one of which throws the tooth off",
            {"te": scaled(TRIANGLE, 8.0), "contact_law": "compliant", "force": 1.5}, "rest",
            0.0, 3)


# --- starts -------------------------------------------------------------------------------------


@case
def start_arriving():
    return ("a start in separation at φ = 0 with φ' > 0", {"te": SMOOTH}, ("separation", 0.0, 0.5),
            0.25, 1, {"kinds": ["IMPACT"], "closed": {("IMPACT", 0, "tau"): mpf(0)},
                      "by": "an impact at once"})


@case
def start_arriving_at_the_coast_flank():
    return ("a start in separation at the coast flank, moving into it", {"te": SMOOTH, **GAP},
            ("separation", -1.0, -0.5), 0.25, 1,
            {"kinds": ["BACK_IMPACT"], "closed": {("BACK_IMPACT", 0, "tau"): mpf(0)},
             "by": "an impact at once"})


@case
def start_deep_in_the_drive_flank():
    return ("a start 200 deflections deep in the drive flank",
            {"te": SMOOTH, "contact_law": "compliant", "backlash": 2.0},
            ("engagement", 200.0, -30.0), 0.25, 2)


@case
def start_deep_in_the_coast_flank():
    return ("a start 100 backlashes deep in the coast flank",
            {"te": SMOOTH, "contact_law": "compliant", "backlash": 2.0},
            ("back_engagement", -202.0, 5.0), 0.25, 2)


@case
def start_on_a_flank_that_leaves():
    return ("a start in contact at φ = φ' = 0 where the flank turns away",
            {"te": scaled(SMOOTH, 40.0)}, ("engagement", 0.0, 0.0), 0.75, 2,
            {"kinds": ["RELEASE"], "closed": {("RELEASE", 0, "tau"): mpf(0)},
             "by": "F < g'' at phase 3/4"})


# --- tables -------------------------------------------------------------------------------------


@case
def three_knots():
    return ("a table of three knots, both flanks", {
        "te": scaled(SMOOTH, 4.0), "restitution": 0.8, "backlash": 0.5, "force": 0.25}, "rest",
        0.0, 2)


@case
def thousand_knots():
    return ("a table of a thousand knots, contact and flight", {
        "te": {"bump_rows": 1000, "height": 4.0}, "restitution": 0.5, "force": 0.5}, "rest",
        0.0, 1)


@case
def thousand_knots_compliant():
    return ("the same with compliant contact on both flanks", {
        "te": {"bump_rows": 1000, "height": 4.0}, "contact_law": "compliant", "force": 0.5,
        "backlash": 1.0}, "rest", 0.0, 1)


# --- loads --------------------------------------------------------------------------------------


def unloaded(force, law):
    return {"te": SMOOTH, "force": force, "restitution": 0.9, "backlash": 0.5, "contact_law": law}


@case
def no_load():
    return ("F = 0: straight flights between moving flanks", unloaded(0.0, "restitution"),
            ("separation", -0.25, 0.125), 0.25, 3)


@case
def no_load_compliant():
    return ("F = 0, compliant", unloaded(0.0, "compliant"), ("separation", -0.25, 0.125), 0.25, 3)


@case
def coasting():
    return ("F < 0", unloaded(-0.25, "restitution"), "rest", 0.0, 2)


@case
def coasting_compliant():
    return ("F < 0, compliant", unloaded(-0.25, "compliant"), "rest", 0.0, 2)


@case
def coasting_rigid():
    return ("F < 0, rigid", unloaded(-0.25, "rigid"), "rest", 0.0, 2)


@case
def both_flanks_in_one_step():
    v, f = 0.75, mpf(0.25)
    hit = (v - mp.sqrt(v * v - 2 * f)) / f
    speed = mp.sqrt(v * v - 2 * f) / 2
    back = (mp.sqrt(speed**2 + 2 * f) - speed) / f
    return ("a flight whose path beyond the coast flank crosses the drive flank too, in one step",
            {"force": 0.25, "period": 1024.0, **GAP}, ("separation", 0.0, -v), 0.0, 1,
            {"closed": {("BACK_IMPACT", 0, "tau"): hit, ("IMPACT", 0, "tau"): hit + back},
             "by": "φ = -vs + Fs²/2"})
