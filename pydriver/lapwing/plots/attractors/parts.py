"""What figures of attractors share: colours and names."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lapwing.base.arrivals import arrivals_in
from lapwing.plots import style

if TYPE_CHECKING:
    import xarray as xr

# A motion without separation is grey; the others in their order, told apart by the colour-blind.
CONTACT, NOT_KNOWN = "0.75", style.BLACK
COLOURS = (style.SKY, style.ORANGE, style.GREEN, style.PURPLE, style.BLUE, style.VERMILION,
           style.YELLOW, "#6B2A57", "#00584A", "0.45")


def colours(data: xr.Dataset) -> list[str]:
    """A colour for each attractor; of more than there are colours the last ones share one."""
    found, separated = [], 0
    for depth in data["deepest_separation"].values:
        if depth == 0:
            found.append(CONTACT)
        else:
            found.append(COLOURS[min(separated, len(COLOURS) - 1)])
            separated += 1
    return found


def name_of(data: xr.Dataset, number: int) -> str:
    """What the attractor of a number, from 0, is called in a legend: what it does."""
    one = data.isel(attractor=number)
    if float(one["deepest_separation"]) == 0:
        return "contact kept"
    period = f"period {int(one['period'])}" if int(one["period"]) else "no period"
    rate, word = float(one["impacts_per_cycle"]), arrivals_in(data.attrs).word
    depth = float(f"{style.URAD * float(one['deepest_separation']):.3g}")
    return f"{period}, {rate:.3g} {word}{'s' * (rate != 1)} a cycle, {depth:g} µrad deep"
