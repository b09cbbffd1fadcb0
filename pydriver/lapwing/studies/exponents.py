"""Lyapunov exponents of the motion from any start."""

from __future__ import annotations

from lapwing.base import arguments, estimates
from lapwing.base.arguments import MAX_INT
from lapwing.engine import Numerics, TrajectoryCall, Wanted, chosen
from lapwing.model.oscillator import Oscillator
from lapwing.studies import stability
from lapwing.studies.orbit import follow_cycles
from lapwing.studies.stability import CycleMaps, Exponents
from lapwing.studies.trajectory import checked_start, engine_start


@arguments.complete()
def exponents(osc: Oscillator, start: str | tuple[object, float, float] = "rest", *,
              phase: float = 0.0, settle: int = 400, record: int = 1000,
              numerics: Numerics | None = None) -> Exponents:
    """Lyapunov exponents of the motion from a start, as means over recorded mesh cycles.

    Nothing is taken to repeat: of a periodic motion `find_orbit` gives the multipliers themselves.

    Parameters
    ----------
    osc : Oscillator
    start : 'rest' or (motion_state, phi, phi_dot), rad and rad per τ
    phase : float, mesh phase at the start, 0 <= phase < 1
    settle, record : int, mesh cycles before recording (>= 0), and recorded (>= 1)
    numerics : Numerics or None, which is Numerics(rtol=1e-8)

    Returns
    -------
    Exponents
        largest, second (per τ; -inf: lost in chatter or rest) and error, half of the 95 % interval.

    Raises
    ------
    TypeError, ValueError
        for a refused argument.
    NoOrbit
        where the run fails numerically.
    """
    arguments.instance("osc", osc, Oscillator)
    phase = arguments.phase("phase", phase)
    settle = arguments.whole("settle", settle, 0, MAX_INT // 4)
    record = arguments.whole("record", record, 1, MAX_INT // 4)
    numerics = chosen(numerics, rtol=(1e-8, 1e-8))
    estimates.require(estimates.sweep_bytes(1, settle + record, exponents=True), "exponents",
                      "settle or record")
    first = settle + (phase > 0)  # whole cycles are recorded
    state = (*engine_start(osc, checked_start(osc, start, phase)), phase)
    call = TrajectoryCall(osc, state, numerics=numerics, wanted=Wanted(cycles=True, tangent=True))
    follow_cycles(call, first + record)
    assert call.tangent is not None  # it is wanted
    kept = call.cycles["cycle"] >= first
    size = max(abs(osc.force), call.cycles["deepest_separation"][kept].max()) or osc.backlash
    return stability.exponents(CycleMaps.from_rows(call.tangent[kept], osc.period), 0, size)
