"""The main result of each study in one line."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from lapwing.base.registry import carried_out

if TYPE_CHECKING:
    import xarray as xr


def headlines(found: dict[str, dict[str, xr.Dataset]], missing: Any = ()) -> tuple[str, ...]:
    """One line for each study.

    Parameters
    ----------
    found : dict of kind -> dict of name -> Dataset
    missing : sequence of (kind, name), studies of the deck without a result

    Returns
    -------
    tuple of str
    """
    return (*(f"{name}: {study.part('report').headline(dataset)}" for study in carried_out()
              for name, dataset in found.get(study.kind, {}).items()),
            *(f"{name}: not finished, no result" for _, name in missing))
