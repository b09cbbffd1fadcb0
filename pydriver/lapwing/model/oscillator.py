"""The dimensionless lapping oscillator: relative angle θ, time τ = ω't, flank motion g.

Separation is θ'' = F; engagement θ'' = F - 2ξφ' - φ with φ = θ - g.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, field, fields, replace
from enum import IntEnum
from functools import cache, cached_property
from typing import Any

from numpy.typing import NDArray

from lapwing.base import arguments
from lapwing.base.arguments import MOST, Refusals
from lapwing.base.codes import ContactLaw, Gap, ImpactLaw
from lapwing.base.messages import facts_html
from lapwing.model.transmission_error import TransmissionError

# Numbers that differ by no more, in parts of them, are the same but for rounding.
ALIKE = 1e-14
TE_SIGNS = {"printed": 1.0, "geometric": -1.0}


class ParameterError(ValueError):
    """Every refused parameter of one object at once; `problems` holds one sentence each."""

    def __init__(self, what: str, problems: Sequence[str]) -> None:
        self.problems = tuple(problems)
        super().__init__(f"{what}: " + "; ".join(self.problems))


@arguments.complete()
@dataclass(frozen=True)
class Scales:
    """What turns dimensionless results into physical units.

    Parameters
    ----------
    natural_frequency : float, rad/s; τ = natural_frequency · t
    force_per_torque : float, rad/(N·m); F per unit of braking torque at balanced drive torque
    """

    natural_frequency: float
    force_per_torque: float

    def __post_init__(self) -> None:
        problems = number_problems(self, positive=("natural_frequency", "force_per_torque"))
        if problems:
            raise ParameterError("scales", problems)


@dataclass(frozen=True)
class Load:
    """The torques and the speed an oscillator was made from.

    Parameters
    ----------
    force : float, rad; the force F they give
    brake_torque : float, N·m; on the gear
    drive_torque : float or None, N·m; on the pinion; None: the balance
    mesh_frequency_ratio : float; Ω that the speed gives
    speed : (str, float) or None, as what it was given, and its value
    """

    force: float
    brake_torque: float
    drive_torque: float | None = None
    mesh_frequency_ratio: float = math.nan
    speed: tuple[str, float] | None = None


@dataclass(frozen=True)
class MeanRotation:
    """What a second degree of freedom adds: both wheels' mean rotation (docs/model.md, section 11).

    Θ = (i12·J1·θ1 + J2·θ2)/(i12²·J1 + J2), on the gear's side, ahead of the nominal rotation.

    Parameters
    ----------
    acceleration : float, rad; Θ'' in τ, (i12·T_m - T_l)/((i12²·J1 + J2)·ω'²)
    pinion_share : float, 0 to 1; J2/(i12²·J1 + J2), the pinion's part in the relative angle
    pinion_rate : float, rad per τ; n1/ω', nominal
    """

    acceleration: float
    pinion_share: float
    pinion_rate: float

    def __post_init__(self) -> None:
        problems = number_problems(self, finite=("acceleration",), positive=("pinion_rate",),
                                   unit_interval=("pinion_share",))
        if problems:
            raise ParameterError("mean rotation", problems)

    def shafts(self, gear_ratio: float, relative: Any, mean: Any) -> tuple[Any, Any]:
        """θ1 and θ2, or their rates, from θ and Θ, or theirs; numbers or arrays of one shape."""
        gear = mean - (1 - self.pinion_share) / gear_ratio * relative
        return relative + gear_ratio * gear, gear

    def mean_speed(self, osc: Oscillator, rate: NDArray[Any]) -> NDArray[Any]:
        """Mean speed of the pinion, rad/s, at a rate Θ' (rad per τ).

        Raises
        ------
        ValueError
            for an oscillator that was made without a gear pair.
        """
        if osc.scales is None:
            raise ValueError("this oscillator has no scales: its units are not known")
        return (self.pinion_rate + osc.gear_ratio * rate) * osc.scales.natural_frequency


@arguments.complete()
@dataclass(frozen=True, kw_only=True, repr=False)
class Oscillator:
    """Parameters of the dimensionless oscillator, checked against each other.

    Parameters
    ----------
    te : TransmissionError
    force : float, rad; mean force F, any sign
    mesh_frequency_ratio : float; Ω = mesh frequency (rad/s) over natural frequency, > 0
    gear_ratio : float; i12 = Z2/Z1, > 0
    damping_ratio : float; ξ >= 0
    restitution : float; ε, 0 to 1
    backlash : float, rad; θ0 > 0
    contact_law : 'restitution', 'compliant' or 'rigid'
    impact_law : 'relative' or 'absolute' (with 'restitution' only)
    gap : 'one_sided', 'symmetric' or 'one_flank'
    back_flank_te : bool; False: the coast flank stands still at θ = -gap_width
    te_sign : 'printed' (g = +i12·Δφ) or 'geometric' (g = -i12·Δφ)
    te_scale : float; factor of the transmission error: Δφ is te_scale times `te`
    scales : Scales or None
    mean_rotation : MeanRotation or None; with it there are two degrees of freedom (no 'rigid' law)
    load : Load or None, the torques behind `force` and the speed behind `mesh_frequency_ratio`; of
        others they say nothing

    Raises
    ------
    ParameterError
        (a ValueError) listing every parameter and combination refused.
    """

    te: TransmissionError = field(kw_only=False)
    force: float
    mesh_frequency_ratio: float
    gear_ratio: float = 1.0
    damping_ratio: float = 0.0
    restitution: float
    backlash: float
    contact_law: str = "restitution"
    impact_law: str = "relative"
    gap: str = "one_sided"
    back_flank_te: bool = True
    te_sign: str = "printed"
    te_scale: float = 1.0
    scales: Scales | None = None
    mean_rotation: MeanRotation | None = None
    load: Load | None = field(default=None, compare=False, repr=False)

    def __post_init__(self) -> None:
        problems = number_problems(
            self, finite=("force", "te_scale"),
            positive=("mesh_frequency_ratio", "gear_ratio", "backlash"),
            not_negative=("damping_ratio",), unit_interval=("restitution",))
        problems += self._choice_problems()
        if not problems and not abs(self.flank_scale) * self.te.magnitude <= MOST:
            problems = [("te_scale times " if self.te_scale != 1 else "")
                        + f"gear_ratio times the transmission error is beyond {MOST:g} rad"]
        if not problems:
            problems = self._flank_problems()
        if problems:
            raise ParameterError("oscillator", problems)

    def __repr__(self) -> str:
        said = ", ".join(f"{name}={fact!r}" for name, fact in self._facts().items())
        return f"Oscillator({self.te!r}, {said})"

    def _repr_html_(self) -> str:
        return facts_html("Oscillator", {"transmission error": self.te, **self._facts()})

    def _facts(self) -> dict[str, object]:
        """Every parameter but the table, without those that are at their defaults."""
        return {f.name: getattr(self, f.name) for f in fields(self)
                if f.repr and f.name != "te" and getattr(self, f.name) != f.default}

    def _choice_problems(self) -> list[str]:
        choices = {"contact_law": names(ContactLaw), "impact_law": names(ImpactLaw),
                   "gap": names(Gap), "te_sign": tuple(TE_SIGNS)}
        taken = Refusals()
        for key, allowed in choices.items():
            taken.take(arguments.choice, key, getattr(self, key), allowed)
        if not isinstance(self.te, TransmissionError):
            taken.problems.append("te must be a TransmissionError, not "
                                  + arguments.shown(self.te))
        if self.scales is not None:
            taken.take(arguments.instance, "scales", self.scales, Scales)
        if self.mean_rotation is not None:
            taken.take(arguments.instance, "mean_rotation", self.mean_rotation, MeanRotation)
            if self.contact_law == "rigid":
                taken.problems.append("degrees_of_freedom = 2 goes with contact_law 'restitution' "
                                      "or 'compliant', not 'rigid'")
        if self.load is not None:
            taken.take(arguments.instance, "load", self.load, Load)
        # A NumPy bool becomes one of Python.
        object.__setattr__(self, "back_flank_te",
                           taken.take(arguments.flag, "back_flank_te", self.back_flank_te))
        laws = (self.contact_law, self.impact_law)
        if all(isinstance(law, str) for law in laws) and laws[1] == "absolute" \
                and laws[0] in set(names(ContactLaw)) - {"restitution"}:
            taken.problems.append("impact_law 'absolute' goes with contact_law 'restitution' only, "
                                  f"not {self.contact_law!r}")
        return taken.problems

    def _flank_problems(self) -> list[str]:
        if self.back_flank_te or self.gap_width + self.flank_extrema[0] > 0:
            return []
        return [f"back_flank_te is off and the drive flank reaches {self.flank_extrema[0]:.6g} rad"
                f", at or beyond the standing coast flank at {-self.gap_width:.6g} rad"]

    @property
    def brake_torque(self) -> float | None:
        """Brake torque on the gear, N·m: as given, or for `force` at the balance.

        None where neither is known: the oscillator was made without a gear pair.
        """
        return self.operation.get("brake_torque")

    @property
    def operation(self) -> dict[str, float]:
        """Torques (N·m) and speed by their names in `GearPair.oscillator`, those that are known.

        As given where they still give `force` and `mesh_frequency_ratio`, to rounding; else, with
        `scales`, brake_torque at the balance and mesh_frequency_hz.
        """
        known: dict[str, float] = {}
        load, scales = self.load, self.scales
        if load is not None and math.isclose(load.force, self.force, rel_tol=ALIKE):
            known["brake_torque"] = load.brake_torque
            if load.drive_torque is not None:
                known["drive_torque"] = float(load.drive_torque)
        elif scales is not None:
            known["brake_torque"] = self.force / scales.force_per_torque
        if load is not None and load.speed is not None and math.isclose(
                load.mesh_frequency_ratio, self.mesh_frequency_ratio, rel_tol=ALIKE):
            known[load.speed[0]] = load.speed[1]
        elif scales is not None:
            frequency = self.mesh_frequency_ratio * scales.natural_frequency
            known["mesh_frequency_hz"] = frequency / (2 * math.pi)
        return known

    @property
    def degrees_of_freedom(self) -> int:
        """2 with a mean rotation, else 1."""
        return 1 if self.mean_rotation is None else 2

    @property
    def period(self) -> float:
        """Mesh period P = 2π/Ω in τ."""
        return 2 * math.pi / self.mesh_frequency_ratio

    @property
    def flank_scale(self) -> float:
        """±i12·te_scale, so that g is flank_scale times `te`."""
        return TE_SIGNS[self.te_sign] * self.gear_ratio * self.te_scale

    @property
    def flank_extrema(self) -> tuple[float, float]:
        """Least and greatest g, rad."""
        low, high = sorted(self.flank_scale * value for value in self.te.extrema)
        return low, high

    @property
    def gap_width(self) -> float:
        """Distance between the flanks, rad: θ0, 2θ0 (symmetric) or infinite (one_flank)."""
        return {"one_sided": self.backlash, "symmetric": 2 * self.backlash}.get(self.gap, math.inf)

    @property
    def angle_scale(self) -> float:
        """The angle tolerances refer to, rad: min(θ0, max(|F|, peak-to-peak g)).

        With neither force nor transmission error nothing but θ0 is left.
        """
        motion = max(abs(self.force), abs(self.flank_scale) * self.te.peak_to_peak)
        return min(self.backlash, motion) if motion > 0 else self.backlash

    @cached_property
    def kept(self) -> dict[Any, Any]:
        """What is made of it once and serves as long as it lives; it makes no difference to it."""
        return {}

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "kept"}

    @arguments.complete()
    def with_force(self, force: float) -> Oscillator:
        """The same oscillator under another mean force F (rad); ParameterError as `Oscillator`."""
        # No other parameter is checked against the force: one that is a number needs no more.
        if type(force) is not float or not abs(force) <= MOST:
            return replace(self, force=force)
        made = copy(self)
        object.__setattr__(made, "force", force)
        return made


@cache
def names(codes: type[IntEnum]) -> tuple[str, ...]:
    """Lower-case names of an IntEnum, as decks and keywords spell them."""
    return tuple(code.name.lower() for code in codes)


def number_problems(owner: Any, *, finite: Sequence[str] = (), positive: Sequence[str] = (),
                    not_negative: Sequence[str] = (),
                    unit_interval: Sequence[str] = ()) -> list[str]:
    """One sentence for each named attribute of `owner` that is not a number of its kind.

    The others become plain floats, also in a frozen dataclass.
    """
    taken = Refusals()
    kinds: tuple[tuple[Sequence[str], Callable[..., float], dict[str, float]], ...] = (
        (finite, arguments.real, {}), (positive, arguments.positive, {}),
        (not_negative, arguments.not_negative, {}),
        (unit_interval, arguments.real, {"low": 0.0, "high": 1.0}))
    for keys, converter, limits in kinds:
        for key in keys:
            number = taken.take(converter, key, getattr(owner, key), **limits)
            if number is not None:
                object.__setattr__(owner, key, number)
    return taken.problems
