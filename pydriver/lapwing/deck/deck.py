"""A checked deck: its values, and the objects of the driver made from them."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lapwing.base.messages import printable
from lapwing.base.quantities import CURVE
from lapwing.model.gear_pair import GearPair

if TYPE_CHECKING:
    from lapwing.model.curve.fit import CurveFit
    from lapwing.model.oscillator import Oscillator
    from lapwing.model.transmission_error.table import TransmissionError


@dataclass(frozen=True)
class Asked:
    """A study as a deck asks for it.

    Its attributes are the keys of its group (`deck.keys`), and before them what follows from the
    keys and the other groups: `values` as an array, `parameter` as the bare key.

    Attributes
    ----------
    kind : str
    keys : StudyKeys, the keys as the group gives them, defaults filled in
    operation : dict, the keyword arguments of `GearPair.oscillator` but for a parameter varied
    rtol : float
    resolved : dict of name -> value
    """

    kind: str
    keys: Any
    operation: dict[str, Any]
    rtol: float
    resolved: dict[str, Any]

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or name in ("resolved", "keys"):
            raise AttributeError(name)
        return self.resolved[name] if name in self.resolved else getattr(self.keys, name)


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
    studies : dict of kind -> tuple of Asked, in deck order
    """

    path: Path
    text: str
    overrides: tuple[tuple[str, str], ...]
    warnings: tuple[Any, ...]
    settings: dict[str, Any]
    te_table: Any
    gear_pair: GearPair
    operation: dict[str, Any]
    numerics: dict[str, Any]
    studies: dict[str, tuple[Asked, ...]] = field(default_factory=dict)
    _curves: dict[tuple[str, str], dict[str, TransmissionError]] = field(default_factory=dict)

    @property
    def responses(self) -> tuple[Asked, ...]:
        """Trajectories to examine closely."""
        return self.studies.get("response", ())

    @property
    def sweeps(self) -> tuple[Asked, ...]:
        """Parameters to run over a range."""
        return self.studies.get("sweep", ())

    @property
    def criticals(self) -> tuple[Asked, ...]:
        """Critical values to find."""
        return self.studies.get("critical", ())

    @property
    def stem(self) -> str:
        """File name without its ending."""
        return self.path.stem

    @property
    def title(self) -> str:
        """The stem as text: what is no UTF-8 in it is written as an escape."""
        return printable(self.stem)

    @cached_property
    def te(self) -> TransmissionError:
        """The `TransmissionError`, built (and SciPy imported) at the first use."""
        te: TransmissionError = self.curve.te if self.curve else self.te_table.build()
        return te

    @cached_property
    def curve(self) -> CurveFit | None:
        """The `CurveFit` of measured samples, or None where none is asked for."""
        return self.te_table.curve() if self.te_table.fit else None

    def curves_of(self, study: Asked) -> dict[str, TransmissionError]:
        """Those that a study varies, by their labels; none but along the axis `te`."""
        key = study.kind, study.name
        if key not in self._curves:
            self._curves[key] = {label: table.build()
                                 for label, table in study.resolved.get("tables", {}).items()}
        return self._curves[key]

    def axes_of(self, study: Asked, axes: dict[str, Any]) -> dict[str, Any]:
        """Values of the parameters as studies take them: of labels the curves that they mean."""
        return {name: {label: self.curves_of(study)[label] for label in map(str, values)}
                if name == CURVE else values for name, values in axes.items()}

    def numerics_of(self, study: Asked) -> dict[str, Any]:
        """Keyword arguments rtol … max_steps_per_cycle that `simulate` and `sweep` share."""
        names = ("method", "chatter_tol", "count_depth", "max_events_per_cycle",
                 "max_steps_per_cycle")
        return {"rtol": study.rtol, **{name: self.numerics[name] for name in names}}

    def oscillator(self, response: Asked) -> Oscillator:
        """The `Oscillator` of a response."""
        return self.gear_pair.oscillator(self.te, **response.operation)
