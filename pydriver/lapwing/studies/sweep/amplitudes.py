"""The classical picture of a sweep: how much φ, the dynamic transmission error and the force move.

Each point goes on from its last state over whole periods, sampled evenly; mesh forces are those of
`mesh_force`, which needs no sampling.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base.codes import Status
from lapwing.engine.records import SAMPLE
from lapwing.studies.response.mesh_force import flank_motion, sample_phases
from lapwing.studies.response.recording import Pass

if TYPE_CHECKING:
    from lapwing.engine.numerics import Numerics
    from lapwing.model.oscillator import Oscillator

# Mesh cycles of a motion without a period, and samples in each cycle. Between samples a parabola
# of n arcs in a cycle hides 1/(4·(SAMPLES/n)²) of its height: 2e-4 for 12 arcs.
CYCLES, SAMPLES = 32, 400
# Names of the results, in the order of `_of_point`.
NAMES = ("phi_rms", "phi_peak_to_peak", "dynamic_te_rms", "dynamic_te_peak_to_peak",
         "mesh_force_mean", "mesh_force_peak")


def amplitudes(oscillators: list[Oscillator], finals: NDArray[Any], periods: NDArray[Any],
               newtons: list[float], phase: float, *, numerics: Numerics,
               threads: int) -> dict[str, NDArray[Any]]:
    """Amplitudes of φ, of the dynamic transmission error θ = φ + g, and mesh forces.

    Parameters
    ----------
    oscillators : sequence of Oscillator (points,)
    finals : table (points,), how each point's run ended, `engine.SweepResult.outcome`
    periods : array (points,) of int, 0: none found
    newtons : sequence of float (points,), k'·lever, force per unit of deflection (N)
    phase : float, mesh phase of the ends
    numerics : Numerics
    threads : int

    Returns
    -------
    dict of name -> array (points,)
        rms about the mean, and peak to peak, rad; mean and largest magnitude of the force of
        spring and damper, N, impacts apart (NaN: rigid law); all NaN where a point failed
    """
    found = np.full((len(oscillators), len(NAMES)), np.nan)

    def one(i: int) -> None:
        if finals[i]["status"] == Status.OK:
            start = (*(finals[i][name] for name in SAMPLE), phase)
            found[i] = _of_point(oscillators[i], start, int(periods[i]) or CYCLES, newtons[i],
                                 numerics)

    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(one, range(len(oscillators))))
    return dict(zip(NAMES, found.T, strict=True))


def _of_point(osc: Oscillator, start: tuple[float, float, float, float], cycles: int, newton: float,
              numerics: Numerics) -> NDArray[Any]:
    grid, stored = sample_phases(osc, SAMPLES)
    # With a section at another phase than 0, the cycle under way is left out.
    recording = Pass(osc, start, (int(start[-1] > 0), cycles), grid, numerics).whole()
    if recording.status != Status.OK:
        return np.full(len(NAMES), np.nan)
    phi = recording.samples["phi"][:-1].reshape(cycles, -1)[:, stored]
    theta = phi + flank_motion(osc, grid[stored])[0]
    mean, peak = recording.forces
    return np.array([phi.std(), np.ptp(phi), theta.std(), np.ptp(theta),
                     newton * mean.mean(), newton * peak.max()])
