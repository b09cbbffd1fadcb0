"""Samples and events of a response joined to one path, cut at impacts and by motion state."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base.codes import EventKind, MotionState

if TYPE_CHECKING:
    import xarray as xr

# Motion state right before and right after an event; a kink changes none.
_FREE, _DRIVE, _COAST = (int(state) for state in (
    MotionState.SEPARATION, MotionState.ENGAGEMENT, MotionState.BACK_ENGAGEMENT))
_AFTER = {
    EventKind.IMPACT: _FREE, EventKind.BACK_IMPACT: _FREE,
    EventKind.RELEASE: _FREE, EventKind.BACK_RELEASE: _FREE,
    EventKind.ENGAGE: _DRIVE, EventKind.BACK_ENGAGE: _COAST,
    EventKind.CHATTER_END: _DRIVE, EventKind.BACK_CHATTER_END: _COAST,
}
IMPACTS = (EventKind.IMPACT, EventKind.BACK_IMPACT)
# Contact that takes less of the motion's range than this is shown on a scale of its own.
MAGNIFIED = 0.6


@dataclass(frozen=True)
class Path:
    """Nodes in time order, an event being two of them (before, after).

    Attributes
    ----------
    position : array (n,), mesh cycles from the first recorded one
    phi, phi_dot : array (n,), rad and rad per τ
    state : array (n,), motion state of the stretch that begins at the node
    jump : array (n - 1,) bool, whether the step to the next node is the instant of an event
    kind : array (n,), kind of the event a node belongs to, 0 for none
    """

    position: np.ndarray
    phi: np.ndarray
    phi_dot: np.ndarray
    state: np.ndarray
    jump: np.ndarray
    kind: np.ndarray

    def stretches(self, state: Any, *columns: NDArray[Any]) -> list[NDArray[Any]]:
        """Columns of all stretches in one motion state, parted by NaN for one call of `plot`."""
        steps = np.flatnonzero(~self.jump & (self.state[:-1] == state))
        runs = np.split(steps, np.flatnonzero(np.diff(steps) > 1) + 1) if steps.size else []
        order = [np.append(run, (run[-1] + 1, -1)) for run in runs]
        return _gathered(order, columns)

    def refined(self, response: xr.Dataset, parts: int = 4) -> Path:
        """The path with more nodes: cubic Hermite pieces, for φ' is the slope of φ."""
        width = np.diff(self.position) * 2 * np.pi / float(response.attrs["mesh_frequency_ratio"])
        s = (np.arange(parts) / parts)[:, None]
        chord = np.divide(np.diff(self.phi), width, out=self.phi_dot[:-1].copy(),
                          where=width > 0)
        left, right = self.phi_dot[:-1], np.where(width > 0, self.phi_dot[1:], 0)
        bend = 3 * chord - 2 * left - right
        twist = left + right - 2 * chord
        phi = self.phi[:-1] + width * s * (left + s * (bend + s * twist))
        phi_dot = left + s * (2 * bend + 3 * s * twist)
        smooth = np.where(self.jump | (width == 0), s == 0, True)
        keep = smooth.T.ravel()

        def joined(inner: NDArray[Any], last: float) -> NDArray[Any]:
            return np.append(inner.T.ravel()[keep], last)

        same = np.broadcast_to
        return Path(joined(self.position[:-1] + s * np.diff(self.position), self.position[-1]),
                    joined(phi, self.phi[-1]), joined(phi_dot, self.phi_dot[-1]),
                    joined(same(self.state[:-1], phi.shape), self.state[-1]),
                    same(self.jump, phi.shape).T.ravel()[keep],
                    joined(same(self.kind[:-1], phi.shape), self.kind[-1]))

    def pressed(self, response: xr.Dataset) -> bool:
        """Whether the motion is both free and pressed into the drive flank, a little (rigid: not).

        What is pressed in as far as it is free needs no scale of its own.
        """
        return self._magnified(MotionState.ENGAGEMENT, float(np.max(self.phi)), response)

    def pressed_back(self, response: xr.Dataset) -> bool:
        """The same of the coast flank, where that moves as the drive flank does."""
        depth = -float(response.attrs["gap_width"]) - float(np.min(self.phi))
        return bool(int(response.attrs.get("back_flank_te", 1))) \
            and self._magnified(MotionState.BACK_ENGAGEMENT, depth, response)

    def _magnified(self, state: MotionState, depth: float, response: xr.Dataset) -> bool:
        low, high = self.limits(response)
        return bool(0 < depth < MAGNIFIED * (high - low)
                    and np.any(self.state == MotionState.SEPARATION)
                    and np.any(self.state == state))

    def limits(self, response: xr.Dataset) -> tuple[float, float]:
        """Lowest and highest φ (rad) to show: of the motion, with the flanks that it comes near."""
        low, high = float(np.nanmin(self.phi)), float(np.nanmax(self.phi))
        gap = float(response.attrs["gap_width"])
        near_coast, near_drive = low < -0.5 * gap, high > -0.5 * gap
        low = min(low, -gap) if near_coast else low
        high = max(high, 0.0) if near_drive else high
        return (low if near_coast else min(low, 0.0)), (high if near_drive else max(high, -gap))

    def jumps(self, kinds: Any, *columns: NDArray[Any]) -> list[NDArray[Any]]:
        """Columns at both ends of each jump of the velocity at such events, parted by NaN."""
        steps = np.flatnonzero(self.jump & (self.phi_dot[:-1] != self.phi_dot[1:])
                               & np.isin(self.kind[:-1], [int(kind) for kind in kinds]))
        return _gathered([np.array((step, step + 1, -1)) for step in steps], columns)


def _gathered(order: list[NDArray[Any]],
              columns: tuple[NDArray[Any], ...]) -> list[NDArray[Any]]:
    nodes = np.concatenate(order) if order else np.zeros(0, int)
    return [np.where(nodes < 0, np.nan, column[nodes]) if nodes.size else np.zeros(0)
            for column in columns]


def cycles_recorded(response: xr.Dataset) -> int:
    """Number of recorded mesh cycles."""
    return int(response.sizes["cycle"])


def events_of(response: xr.Dataset, kinds: Any, first: int = 0) -> dict[str, NDArray[Any]]:
    """Columns of the events of some kinds from a cycle on, as a dict of arrays."""
    kind = response["event_kind"].values
    rows = np.isin(kind, [int(one) for one in kinds])
    rows &= response["event_cycle"].values >= first
    names = ("event_kind", "event_cycle", "event_phase", "event_phi", "velocity_before",
             "velocity_after", "impact_energy")
    columns = {name: response[name].values[rows] for name in names}
    return {**columns, "position": columns["event_cycle"] + columns["event_phase"]}


def impulses(events: dict[str, NDArray[Any]], gear_pair: dict[str, float]) -> NDArray[Any]:
    """Impulse of impacts along the normal, N·s: k'·lever·(φ' before - φ' after)/ω'.

    Of J·Δφ' with J = k/ω'² and k = k'·lever², over the lever.
    """
    newton = float(gear_pair["mesh_stiffness"]) * float(gear_pair["pinion_base_lever"])
    lost: NDArray[Any] = events["velocity_before"] - events["velocity_after"]
    return newton / float(gear_pair["natural_frequency"]) * lost


def path(response: xr.Dataset, cycles: int) -> Path:
    """The last `cycles` recorded cycles of a response, as a Path."""
    first = cycles_recorded(response) - cycles
    rows = response["sample_cycle"].values >= first
    samples = {name: response[name].values[rows].astype(float)
               for name in ("phi", "phi_dot", "motion_state")}
    position = response["sample_cycle"].values[rows] + response["phase"].values[rows]
    events = events_of(response, _shown_kinds(response), first)
    n = events["position"].size
    # At one instant: events in the order of the log, then samples, which see the state after.
    at = np.concatenate([np.repeat(events["position"], 2), position])
    rank = np.concatenate([np.arange(2 * n), np.full(position.size, 2 * n)])
    order = np.lexsort((rank, at))
    velocity = np.stack([events["velocity_before"], events["velocity_after"]], 1).ravel()
    after = np.array([_AFTER.get(EventKind(kind), np.nan) for kind in events["event_kind"]])
    before_node = np.concatenate([np.tile([True, False], n), np.zeros(position.size, bool)])
    state = np.concatenate([np.repeat(after, 2), samples["motion_state"]])
    state[before_node] = np.nan
    return Path(at[order], np.concatenate([np.repeat(events["event_phi"], 2),
                                           samples["phi"]])[order],
                np.concatenate([velocity, samples["phi_dot"]])[order],
                _filled(state[order]), before_node[order][:-1],
                np.concatenate([np.repeat(events["event_kind"], 2),
                                np.zeros(position.size, int)])[order])


def _shown_kinds(response: xr.Dataset) -> list[EventKind]:
    """Kinds that fit into the plane of φ and φ'.

    Where the coast flank stands still its events have velocities relative to that flank.
    """
    standing = not int(response.attrs.get("back_flank_te", 1))
    return [kind for kind in (*_AFTER, EventKind.KINK)
            if not (standing and kind.name.startswith("BACK_"))]


def _filled(state: NDArray[Any]) -> NDArray[Any]:
    """A state that is not known by itself is the one before."""
    known = np.where(np.isnan(state), 0, np.arange(state.size))
    return state[np.maximum.accumulate(known)]


def cycles_shown(response: xr.Dataset, *, repeats: int, aperiodic: int) -> int:
    """How many of the last cycles tell the motion: periods to repeat, or a number without one."""
    period = int(response.attrs["period"])
    wanted = max(repeats, repeats * period) if period else aperiodic
    return min(wanted, cycles_recorded(response))
