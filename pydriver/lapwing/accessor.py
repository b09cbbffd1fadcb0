"""What Datasets of Lapwing can do: `data.lapwing.speed()`, `data.lapwing.orbit_diagram()`.

Registered with the first Dataset that Lapwing makes or opens (`base.registry.give_accessor`); by
hand with `lapwing.accessor.register()`.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from lapwing.base.arguments import choice, complete, flag, wrong
from lapwing.base.arguments import path as file_path
from lapwing.base.messages import nearest
from lapwing.base.quantities import RATE
from lapwing.base.registry import STUDIES

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure

    from lapwing.model.gear_pair import GearPair

SPEED_UNITS = ("rad/s", "m/s")
# What a figure runs into where a part of a Dataset is missing.
UNFIT = (LookupError, TypeError, ValueError)
# Dimensions without coordinates, of which a single value leaves no trace.
UNLABELLED = {"sweep": ("recorded_cycle",), "branches": ("point", "strobe", "event", "special")}


class LapwingAccessor:
    """A response, a sweep, a search or a map, with what it can show of itself.

    Parameters
    ----------
    dataset : xarray.Dataset, of `lapwing.response`, `sweep`, `simulate`, `critical_*` or a file
    """

    def __init__(self, dataset: xr.Dataset) -> None:
        self._dataset = dataset

    @complete()
    def speed(self, name: str | None = None, unit: str = "rad/s",
              gear_pair: GearPair | Mapping[str, Any] | None = None) -> xr.DataArray:
        """A rate in τ as a speed.

        Parameters
        ----------
        name : str or None, a variable in rad per unit of τ; default: impact_velocity of a sweep,
            velocity_before of events
        unit : 'rad/s', of the relative angle, which is one of the pinion; 'm/s', the same along
            the normal of the teeth
        gear_pair : GearPair or group `gear_pair` of a file; default: what the Dataset knows of it

        Returns
        -------
        xarray.DataArray of the shape of the variable

        Raises
        ------
        KeyError
            where there is no such variable.
        TypeError, ValueError
            for a variable that is no rate, an unknown unit, or a Dataset that does not know its
            gear pair.
        """
        choice("unit", unit, SPEED_UNITS)
        if name is None:
            known = ("impact_velocity", "velocity_before", "phi_dot")
            name = next((one for one in known if one in self._dataset), known[0])
        rate = self._dataset[name]
        if "tau" not in str(rate.attrs.get("long_name", "")):
            raise ValueError(wrong("name", name, "a variable in rad per unit of tau"))
        factor = self._of_pair("natural_frequency", gear_pair)
        if unit == "m/s":
            factor *= self._of_pair("pinion_base_lever", gear_pair)
        words = str(rate.attrs["long_name"]).partition(", per unit of")[0]
        return (rate * factor).assign_attrs(units=unit, long_name=words)

    def _of_pair(self, name: str, gear_pair: GearPair | Mapping[str, Any] | None) -> float:
        if gear_pair is None:
            if name not in self._dataset.attrs:
                raise ValueError(f"this Dataset does not tell its {name}: expected gear_pair=")
            return float(self._dataset.attrs[name])
        return float(gear_pair[name] if isinstance(gear_pair, Mapping)
                     else getattr(gear_pair, name))

    def impacts(self, **at: Any) -> xr.Dataset:
        """The listed impacts of one point of a sweep, or of several.

        Parameters
        ----------
        **at : values of the coordinates, as of `Dataset.sel`: start='up', brake_torque=3.3; the
            nearest value of the parameter is taken

        Returns
        -------
        xarray.Dataset over `impact`: impact_phase, impact_velocity, impact_flank, and the
        coordinates of the point of each

        Raises
        ------
        KeyError
            where there are no impacts ('impacts' was not observed), or no such coordinate.
        """
        import numpy as np

        from lapwing.base.arrivals import listed_impacts

        columns = ["impact_phase", "impact_velocity", "impact_flank"]
        if missing := [name for name in columns if name not in self._dataset]:
            raise KeyError(f"no {', '.join(missing)}: expected a sweep with observe=('impacts', …)")
        words = {key: value for key, value in at.items() if isinstance(value, str)}
        numbers = {key: value for key, value in at.items() if key not in words}
        chosen = self._dataset[["first_impact", "kept_impacts"]].sel(words)
        if numbers:
            chosen = chosen.sel(numbers, method="nearest")
        place, point = listed_impacts(chosen)
        listed = self._dataset[columns].isel(impact=place)
        kept = chosen["kept_impacts"]
        index = np.unravel_index(point, kept.shape) if kept.ndim else ()
        return listed.assign_coords({**kept.drop_vars(kept.dims).coords, **{
            dim: ("impact", chosen[dim].values[one])
            for dim, one in zip(kept.dims, index, strict=True)}})

    @complete()
    def table(self, dim: str | None = None, units: bool = False) -> pd.DataFrame:
        """Variables along one dimension as a table, codes in words; into a CSV file: `to_csv`.

        Parameters
        ----------
        dim : str or None, the dimension; default: the only one, or `event`, `impact`, `sample`
            or `cycle`, the first that is there
        units : bool, whether columns are named with their units, `phi [rad]`; `rad per tau` is a
            rate in τ = natural_frequency · t, and what has no unit has none

        Returns
        -------
        pandas.DataFrame, a column for each variable along the dimension alone

        Raises
        ------
        TypeError, ValueError
            where it is not told which dimension is meant.
        """
        import numpy as np
        import pandas as pd

        flag("units", units)
        dims = [str(one) for one in self._dataset.dims]
        usual = [one for one in ("event", "impact", "sample", "cycle") if one in dims]
        if dim is None:
            dim = dims[0] if len(dims) == 1 else usual[0] if usual else None
        if not isinstance(dim, str) or dim not in dims:
            raise ValueError(wrong("dim", dim, f"one of {', '.join(dims)}"))
        columns: dict[str, Any] = {}
        along = {str(name): variable for name, variable in self._dataset.variables.items()
                 if variable.dims == (dim,)}
        # Times first, then what counts the rows, whatever they are beside: coordinates or not.
        for name in sorted(along, key=lambda one: (not one.endswith(("tau", "time")), one != dim)):
            variable = along[name]
            words = str(variable.attrs.get("flag_meanings", "")).split()
            head = f"{name} [{_unit(variable.attrs)}]" if units and _unit(variable.attrs) else name
            if words and "flag_values" in variable.attrs:
                known = dict(zip(np.atleast_1d(variable.attrs["flag_values"]).tolist(), words,
                                 strict=True))
                columns[head] = [known.get(one, "") for one in variable.values.tolist()]
            else:
                columns[head] = variable.values
        return pd.DataFrame(columns)

    @complete()
    def to_csv(self, path: str | os.PathLike[str], dim: str | None = None) -> None:
        """Write `table` into a CSV file, units in its header: `time [s],tau,cycle,phase,kind, …`.

        ``run.events.lapwing.to_csv("events.csv")``

        Parameters
        ----------
        path : str or path
        dim : as of `table`

        Raises
        ------
        TypeError, ValueError
            for a refused argument.
        OSError
            where the file cannot be written.
        """
        self.table(dim, units=True).to_csv(file_path("path", path), index=False)

    def figures(self) -> tuple[str, ...]:
        """Names of the figures that this Dataset can be drawn as, methods of this object."""
        if "stable_range" in self._dataset.dims:
            return ("bifurcation",) if self._shows("bifurcation") else ()
        return tuple(module.rpartition(".")[2] for study in STUDIES.values()
                     if study.kind == self._kind() for module in study.figures
                     if self._shows(module))

    def _shows(self, module: str) -> bool:
        from lapwing.plots import shows

        try:
            return shows(module, self._dataset)
        except UNFIT:
            if self._cut_away():
                return False
            raise

    def _cut_away(self) -> str:
        """What `isel` or `sel` took out of a Dataset, in words; empty text, nothing is seen."""
        single = [str(name) for name, one in self._dataset.coords.items() if one.ndim == 0]
        empty = [str(name) for name, size in self._dataset.sizes.items() if size == 0]
        single += [name for name in UNLABELLED.get(self._kind(), ())
                   if name not in self._dataset.dims]
        return "; ".join(
            [f"of {name} it has a single value and no axis: isel({name}=[i]) keeps one"
             for name in single] + [f"nothing is left of {name}" for name in empty])

    def _kind(self) -> str:
        """Which kind of study it comes from; empty where that cannot be told."""
        if "kind" in self._dataset.attrs:  # of a result file
            return str(self._dataset.attrs["kind"])
        if "sample" in self._dataset.dims:
            return "response"
        if "plane" in self._dataset.attrs:
            return "basins"
        if "continuation_steps" in self._dataset.attrs:
            return "attractors"
        if "x_parameter" in self._dataset.attrs:
            return "map"
        if "find" in self._dataset.attrs:
            return "critical"
        if "sampling" in self._dataset.attrs:
            return "ensemble"
        return "sweep" if "recorded_cycle" in self._dataset.dims else ""

    def __getattr__(self, name: str) -> Callable[..., Figure]:
        """The figure of a name (`figures`): a function of what its `draw` takes by keyword."""
        if name.startswith("_"):
            raise AttributeError(name)
        known = self.figures()
        if name not in known:
            raise AttributeError(self._unknown(name, known))
        from lapwing.plots import figure_of
        from lapwing.results.file import pair_attributes

        def drawn(gear_pair: GearPair | Mapping[str, Any] | None = None, **options: Any) -> Figure:
            if gear_pair is not None and not isinstance(gear_pair, Mapping):
                gear_pair = pair_attributes(gear_pair)
            try:
                return figure_of(name, self._dataset, gear_pair=gear_pair, **options)
            except UNFIT as error:
                why = self._cut_away()
                if not why and not isinstance(error, LookupError):
                    raise
                raise ValueError(f"figure {name} cannot be drawn of this Dataset: " + (
                    why or "its parts do not belong together any more (some were cut, others "
                           "not)")) from error

        return drawn

    def _unknown(self, name: str, figures: tuple[str, ...]) -> str:
        """What to say of a name that is neither a method nor a figure of this Dataset."""
        methods = [one for one in vars(type(self)) if not one.startswith("_")]
        every = [one for study in STUDIES.values() for one in study.figure_names]
        why = "this Dataset has not what the figure shows" if name in every else \
            nearest(name, [*methods, *figures], 3)
        cut = self._cut_away() if name in every else ""
        return f"no method or figure {name!r} of this Dataset, {why}{f' ({cut})' * bool(cut)}; " \
               f"its figures are {', '.join(figures) or 'none'}"

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *self.figures()})


def _unit(attrs: Mapping[Any, Any]) -> str:
    """Unit of a variable as a header says it; empty text, none."""
    unit = str(attrs.get("units", "1"))
    rate = unit == "rad" and "per unit of" in str(attrs.get("long_name", ""))
    return RATE if rate else unit * (unit != "1")


def register() -> None:
    """Give every xarray Dataset the attribute `lapwing`."""
    import xarray as xr

    if not hasattr(xr.Dataset, "lapwing"):
        xr.register_dataset_accessor("lapwing")(LapwingAccessor)  # type: ignore[no-untyped-call]
