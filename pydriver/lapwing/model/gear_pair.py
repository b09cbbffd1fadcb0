"""The spiral-bevel pair in physical units and its reduction to the dimensionless oscillator."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from lapwing.base import arguments
from lapwing.base.arguments import LEAST, MOST, Refusals
from lapwing.base.messages import facts_html
from lapwing.model.oscillator import (
    Load,
    MeanRotation,
    Oscillator,
    ParameterError,
    Scales,
    number_problems,
)

if TYPE_CHECKING:
    from lapwing.model.transmission_error.table import TransmissionError

SPEEDS = ("pinion_speed_rpm", "pinion_speed_rad_s", "mesh_frequency_hz")


@arguments.complete()
@dataclass(frozen=True)
class GearPair:
    """Two rigid bodies coupled by the mesh; torsion only.

    Parameters
    ----------
    pinion_teeth, gear_teeth : int; Z1, Z2
    pinion_inertia, gear_inertia : float, kg·m²; J1, J2, shafts included
    pinion_base_lever : float, m; r_m1·n_mt, lever of the normal mesh force about the pinion axis
    mesh_stiffness : float, N/m; k', mean, along the normal
    backlash : float, rad; θ0, seen by the relative coordinate
    restitution : float; ε, 0 to 1
    damping_ratio : float; ξ          } exactly one of the two
    mesh_damping : float, N·s/m; c'   }

    Raises
    ------
    ParameterError
        (a ValueError) listing every parameter refused.
    """

    pinion_teeth: int
    gear_teeth: int
    pinion_inertia: float
    gear_inertia: float
    pinion_base_lever: float
    mesh_stiffness: float
    backlash: float
    restitution: float
    damping_ratio: float | None = None
    mesh_damping: float | None = None

    def __post_init__(self) -> None:
        taken = Refusals()
        for key in ("pinion_teeth", "gear_teeth"):
            count = taken.take(arguments.whole, key, getattr(self, key), 1)
            object.__setattr__(self, key, getattr(self, key) if count is None else count)
        problems = taken.problems
        damping = [key for key in ("damping_ratio", "mesh_damping")
                   if getattr(self, key) is not None]
        if len(damping) != 1:
            problems.append("exactly one of damping_ratio and mesh_damping is expected, not "
                            + (" and ".join(damping) or "none"))
        problems += number_problems(
            self, positive=("pinion_inertia", "gear_inertia", "pinion_base_lever",
                            "mesh_stiffness", "backlash"),
            not_negative=damping, unit_interval=("restitution",))
        problems = problems or self._derived_problems()
        if problems:
            raise ParameterError("gear pair", problems)

    def _derived_problems(self) -> list[str]:
        """What the numbers give together where that leaves the range of numbers."""
        problems = []
        for name in ("equivalent_inertia", "torsional_stiffness", "natural_frequency",
                     "force_per_torque", "xi"):
            try:
                value = getattr(self, name)
                within = value == 0 if name == "xi" and value == 0 else LEAST <= value <= MOST
            except ArithmeticError:
                value, within = math.nan, False
            if not within:
                problems.append(f"{_FROM[name]} together give {name} = {value:.3g}, expected "
                                f"{LEAST:g} to {MOST:g}")
        return problems[:1]

    def _repr_html_(self) -> str:
        given = {name: value for name, value in asdict(self).items() if value is not None}
        return facts_html("GearPair", {**given, "natural frequency":
                                       f"{self.natural_frequency:.6g} rad/s",
                                       "force per torque": f"{self.force_per_torque:.6g} rad/(N m)",
                                       "damping ratio": f"{self.xi:.6g}"})

    @property
    def gear_ratio(self) -> float:
        """i12 = Z2/Z1."""
        return self.gear_teeth / self.pinion_teeth

    @property
    def equivalent_inertia(self) -> float:
        """J = J1·J2/(i12²·J1 + J2), kg·m²."""
        return self.pinion_inertia * self.gear_inertia / self.total_inertia

    @property
    def total_inertia(self) -> float:
        """M = i12²·J1 + J2, of both wheels turning together, on the gear's side, kg·m²."""
        return self.gear_ratio**2 * self.pinion_inertia + self.gear_inertia

    @property
    def torsional_stiffness(self) -> float:
        """k = k'·(r_m1·n_mt)², N·m/rad."""
        return self.mesh_stiffness * self.pinion_base_lever**2

    @property
    def natural_frequency(self) -> float:
        """ω' = √(k/J), rad/s."""
        frequency: float = _root(self.torsional_stiffness / self.equivalent_inertia)
        return frequency

    @property
    def xi(self) -> float:
        """Damping ratio ξ = c'·(r_m1·n_mt)²/(2√(J·k)), or as given."""
        if self.damping_ratio is not None:
            return self.damping_ratio
        assert self.mesh_damping is not None  # exactly one of the two is given
        critical: float = 2 * _root(self.equivalent_inertia * self.torsional_stiffness)
        return self.mesh_damping * self.pinion_base_lever**2 / critical

    @property
    def force_per_torque(self) -> float:
        """F per braking torque at the balance T_m = T_l/i12: 1/(i12·J·ω'²), rad/(N·m)."""
        return 1 / (self.gear_ratio * self.torsional_stiffness)

    @arguments.complete()
    def force(self, brake_torque: float, drive_torque: float | None = None) -> float:
        """F = i12·T_l/(J2·ω'²) + T_m/(J1·ω'²), rad; torques in N·m, default T_m = T_l/i12.

        Raises
        ------
        TypeError, ValueError
            for a torque that is no finite number.
        """
        brake_torque = arguments.real("brake_torque", brake_torque)
        if drive_torque is not None:
            drive_torque = arguments.real("drive_torque", drive_torque)
        return float(force_at(self, brake_torque, drive_torque))

    def _mean_rotation(self, mesh_frequency_ratio: float, brake_torque: float,
                       drive_torque: float | None = None) -> MeanRotation:
        """`MeanRotation` at Ω and torques in N·m; without a drive torque there is the balance."""
        unbalanced = 0.0 if drive_torque is None else self.gear_ratio * drive_torque - brake_torque
        return MeanRotation(unbalanced / self.total_inertia / self.natural_frequency**2,
                            self.gear_inertia / self.total_inertia,
                            mesh_frequency_ratio / self.pinion_teeth)

    @arguments.complete(one_of=SPEEDS)
    def oscillator(self, te: TransmissionError, *, brake_torque: float,
                   drive_torque: float | None = None, pinion_speed_rpm: float | None = None,
                   pinion_speed_rad_s: float | None = None, mesh_frequency_hz: float | None = None,
                   contact_law: str = "restitution", impact_law: str = "relative",
                   gap: str = "one_sided", back_flank_te: bool = True, te_sign: str = "printed",
                   te_scale: float = 1.0, degrees_of_freedom: int = 1) -> Oscillator:
        """Reduce to the dimensionless oscillator; F as in `force`, Ω = Z1·n1/ω'.

        Parameters
        ----------
        te : TransmissionError
        brake_torque : float, N·m; mean, on the gear
        drive_torque : float, N·m; mean, on the pinion; default: balance
        pinion_speed_rpm, pinion_speed_rad_s, mesh_frequency_hz : exactly one, > 0
        contact_law, impact_law, gap, back_flank_te, te_sign, te_scale : see `Oscillator`
        degrees_of_freedom : 1, the relative angle; 2: the mean rotation too, which any other drive
            torque than the balance makes drift (docs/model.md, section 11)

        Raises
        ------
        ParameterError
            (a ValueError) listing everything refused, the oscillator's own refusals included.
        """
        speeds = {"pinion_speed_rpm": pinion_speed_rpm, "pinion_speed_rad_s": pinion_speed_rad_s,
                  "mesh_frequency_hz": mesh_frequency_hz}
        problems = _drive_problems(speeds, brake_torque, drive_torque)
        taken = Refusals()
        degrees = taken.take(arguments.whole, "degrees_of_freedom", degrees_of_freedom, 1, 2)
        problems += taken.problems
        # A stand-in of 1 where the operating point is refused lets the rest be checked as well.
        force = 1.0 if problems else self.force(brake_torque, drive_torque)
        ratio = 1.0 if problems else self.mesh_frequency(**speeds) / self.natural_frequency
        try:
            result = Oscillator(
                te, force=force, mesh_frequency_ratio=ratio, gear_ratio=self.gear_ratio,
                damping_ratio=self.xi, restitution=self.restitution, backlash=self.backlash,
                contact_law=contact_law, impact_law=impact_law, gap=gap,
                back_flank_te=back_flank_te, te_sign=te_sign, te_scale=te_scale,
                mean_rotation=self._mean_rotation(ratio, brake_torque, drive_torque)
                if degrees == 2 and not problems else None,
                scales=Scales(self.natural_frequency, self.force_per_torque),
                load=None if problems else Load(
                    force, float(brake_torque), drive_torque, ratio,
                    next((name, float(speed)) for name, speed in speeds.items()
                         if speed is not None)))
        except ParameterError as error:
            problems += error.problems
        if problems:
            raise ParameterError("oscillator", problems)
        return result

    @arguments.complete()
    def mesh_frequency(self, pinion_speed_rpm: float | None = None,
                       pinion_speed_rad_s: float | None = None,
                       mesh_frequency_hz: float | None = None) -> float:
        """Angular mesh frequency Z1·n1, rad/s, from the one speed that is given.

        Raises
        ------
        ParameterError
            (a ValueError) unless exactly one is given, a number above 0.
        """
        speeds = {"pinion_speed_rpm": pinion_speed_rpm, "pinion_speed_rad_s": pinion_speed_rad_s,
                  "mesh_frequency_hz": mesh_frequency_hz}
        problems = _drive_problems(speeds, 0.0, None)
        if problems:
            raise ParameterError("mesh frequency", problems)
        return float(frequency_at(self, **speeds))


class Pairs:
    """Derived numbers of many gear pairs at once, by the same formulas.

    Parameters
    ----------
    pair : GearPair, whose numbers those are that are not varied
    varied : name -> array (n,), numbers of each pair, known to be what `GearPair` accepts
    """

    def __init__(self, pair: GearPair, varied: Mapping[str, Any]) -> None:
        vars(self).update({**asdict(pair), **varied})

    gear_ratio = GearPair.gear_ratio
    equivalent_inertia = GearPair.equivalent_inertia
    total_inertia = GearPair.total_inertia
    torsional_stiffness = GearPair.torsional_stiffness
    natural_frequency = GearPair.natural_frequency
    xi = GearPair.xi
    force_per_torque = GearPair.force_per_torque


def _root(value: Any) -> Any:
    """Square root of a number, or of each."""
    return math.sqrt(value) if isinstance(value, float) else np.sqrt(value)


def force_at(pair: Any, brake_torque: Any, drive_torque: Any = None) -> Any:
    """`GearPair.force` of numbers or arrays that are known to be finite."""
    if drive_torque is None:
        return pair.force_per_torque * brake_torque
    gear = pair.gear_ratio * brake_torque / pair.gear_inertia
    return (gear + drive_torque / pair.pinion_inertia) / pair.natural_frequency**2


def frequency_at(pair: Any, pinion_speed_rpm: Any = None, pinion_speed_rad_s: Any = None,
                 mesh_frequency_hz: Any = None) -> Any:
    """`GearPair.mesh_frequency` of one number or array known to be above 0."""
    if mesh_frequency_hz is not None:
        return 2 * math.pi * mesh_frequency_hz
    if pinion_speed_rpm is not None:
        pinion_speed_rad_s = pinion_speed_rpm * math.pi / 30
    return pair.pinion_teeth * pinion_speed_rad_s


# Which given numbers a derived one comes from.
_FROM = {"equivalent_inertia": "pinion_inertia, gear_inertia and the tooth numbers",
         "torsional_stiffness": "mesh_stiffness and pinion_base_lever",
         "natural_frequency": "mesh_stiffness, pinion_base_lever and the inertias",
         "force_per_torque": "mesh_stiffness, pinion_base_lever and the tooth numbers",
         "xi": "mesh_damping, mesh_stiffness, pinion_base_lever and the inertias"}


def _drive_problems(speeds: dict[str, float | None], brake_torque: float | None,
                    drive_torque: float | None) -> list[str]:
    """What is wrong with speed and torques, one sentence each."""
    given = [key for key, value in speeds.items() if value is not None]
    problems = []
    if len(given) != 1:
        problems.append(f"exactly one of {', '.join(speeds)} is expected, not "
                        + (" and ".join(given) or "none"))
    torques = {"brake_torque": brake_torque, "drive_torque": drive_torque}
    if drive_torque is None:
        del torques["drive_torque"]
    values = SimpleNamespace(**speeds, **torques)
    return problems + number_problems(values, positive=given, finite=tuple(torques))
