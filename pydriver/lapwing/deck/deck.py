"""A checked deck: its values, and the objects of the driver made from them."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from lapwing.base.messages import printable
from lapwing.model.gear_pair import GearPair


@dataclass(frozen=True)
class Response:
    """One trajectory to examine.

    Attributes
    ----------
    name : str
    operation : dict, the keyword arguments of `GearPair.oscillator`
    start : 'rest' or (motion state, φ rad, dφ/dτ rad), as `simulate` takes it
    settle_cycles, record_cycles, samples_per_cycle : int
    exponents : bool, whether multipliers and exponents are found
    rtol : float
    claim_impacts_per_cycle, claim_deepest_separation (rad), claim_text : what somebody else
        reports, or None
    """

    name: str
    operation: dict
    start: str | tuple
    settle_cycles: int
    record_cycles: int
    samples_per_cycle: int
    exponents: bool
    rtol: float
    claim_impacts_per_cycle: float | None = None
    claim_deepest_separation: float | None = None
    claim_text: str | None = None


@dataclass(frozen=True, eq=False)
class Sweep:
    """One parameter over a range.

    Attributes
    ----------
    name : str
    parameter : str, the bare key
    group : 'gear_pair' or 'operation', where the parameter belongs
    values : array (n,), ascending, without repeats
    operation : dict, the keyword arguments of `GearPair.oscillator` but for the parameter
    starts : tuple of 'rest', 'up', 'down'
    settle_cycles, record_cycles : int
    impacts : bool, whether every impact is kept
    order_spectra : bool, whether order spectra are made
    speed_density : bool, whether impacts are counted by speed
    amplitudes : bool, whether amplitudes and mesh forces are found
    exponents : bool, whether multipliers and exponents are found
    rtol : float
    """

    name: str
    parameter: str
    group: str
    values: np.ndarray
    operation: dict
    starts: tuple
    settle_cycles: int
    record_cycles: int
    impacts: bool
    order_spectra: bool
    speed_density: bool
    amplitudes: bool
    exponents: bool
    rtol: float


@dataclass(frozen=True, eq=False)
class Critical:
    """One critical value of a parameter to find.

    Attributes
    ----------
    name : str
    find : 'full', 'safe', 'back' or 'on'
    parameter : str, the bare key
    group : 'gear_pair' or 'operation', where the parameter belongs
    values : array (n,), ascending, without repeats; None for a closed form
    safe_end : 'high' or 'low'
    operation : dict, the keyword arguments of `GearPair.oscillator` but for the parameter
    own_operation : bool, whether the group sets some of them itself
    starts : (phases, positions, speeds) of the grid of starts, or None
    settle_cycles : int
    record_cycles : int or None
    resolution : float, of the parameter, or None
    further_values : int
    confidence : float
    rtol : float
    """

    name: str
    find: str
    parameter: str
    group: str
    values: np.ndarray | None
    safe_end: str
    operation: dict
    own_operation: bool
    starts: tuple | None
    settle_cycles: int
    record_cycles: int | None
    resolution: float | None
    further_values: int
    confidence: float
    rtol: float


@dataclass(eq=False)
class Deck:
    """Everything a run needs, checked.

    Attributes
    ----------
    path : Path
    stem : str, the file name without its ending
    text : str, the deck as read
    overrides : tuple of (key, value text)
    warnings : tuple of Problem
    settings : dict, group name -> validated keys (a list of them for the studies)
    te_table : Table, the transmission error as given
    gear_pair : GearPair
    operation : dict, the keyword arguments of `GearPair.oscillator` (scene and te_sign included)
        that &operation gives; may lack brake_torque where every study sets its own
    numerics : dict, the keys of &numerics; rtol is None where each study takes its default
    responses : tuple of Response
    sweeps : tuple of Sweep
    criticals : tuple of Critical
    """

    path: Path
    text: str
    overrides: tuple
    warnings: tuple
    settings: dict
    te_table: object
    gear_pair: GearPair
    operation: dict
    numerics: dict
    responses: tuple = field(default=())
    sweeps: tuple = field(default=())
    criticals: tuple = field(default=())

    @property
    def stem(self):
        """File name without its ending."""
        return self.path.stem

    @property
    def title(self):
        """The stem as text: what is no UTF-8 in it is written as an escape."""
        return printable(self.stem)

    @cached_property
    def te(self):
        """The `TransmissionError`, built (and SciPy imported) at the first use."""
        return self.curve.te if self.curve else self.te_table.build()

    @cached_property
    def curve(self):
        """The `CurveFit` of measured samples, or None where none is asked for."""
        return self.te_table.curve() if self.te_table.fit else None

    def numerics_of(self, study):
        """Keyword arguments rtol … max_steps_per_cycle that `simulate` and `sweep` share."""
        names = ("method", "chatter_tol", "count_depth", "max_events_per_cycle",
                 "max_steps_per_cycle")
        return {"rtol": study.rtol, **{name: self.numerics[name] for name in names}}

    def oscillator(self, response):
        """The `Oscillator` of a response."""
        return self.gear_pair.oscillator(self.te, **response.operation)
