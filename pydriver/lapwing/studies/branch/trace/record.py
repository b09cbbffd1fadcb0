"""A branch as arrays, bit for bit: what is finished outlives the process that made it."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lapwing.studies.branch.motion.curve import Place, multipliers_of
from lapwing.studies.branch.motion.layout import Layout
from lapwing.studies.branch.special import Kind, Outcome, Point, Special

OF_EVENT = ("kind", "flank", "piece", "arc")


def recorded(points: Sequence[Point], specials: Sequence[Special],
             positions: Sequence[int]) -> dict[str, NDArray[Any]]:
    """Arrays from which `restored` makes the same points and special points again."""
    places = [*(one.place for one in points), *(one.place for one in specials)]
    words = json.dumps([one.words for one in specials])
    return {
        "events": np.array([one.layout.n for one in places]),
        "period": np.array([one.layout.cycles for one in places]),
        **{f"event_{name}": np.concatenate([getattr(one.layout, name) for one in places])
           for name in OF_EVENT},
        "z": np.concatenate([one.z for one in places]),
        "tangent": np.concatenate([one.tangent for one in places]),
        "of_point": np.array([(one.value, one.trace, one.det, one.rank) for one in points]),
        "of_special": np.array([
            (one.kind, one.outcome, one.value, one.error, one.flank, one.phase, at,
             *(part for number in one.multipliers for part in (number.real, number.imag)))
            for one, at in zip(specials, positions, strict=True)]),
        "words": np.frombuffer(words.encode(), dtype=np.uint8)}


def restored(arrays: Mapping[str, NDArray[Any]]) -> tuple[
        tuple[Point, ...], tuple[Special, ...], tuple[int, ...]]:
    """Points, special points, and the numbers of the points that these follow."""
    places = list(_places(arrays))
    of_point = arrays["of_point"].reshape(-1, 4)
    points = [Point(float(value), place, float(trace), float(det), int(rank),
                    multipliers_of(float(trace), float(det)))
              for place, (value, trace, det, rank) in zip(places, of_point, strict=False)]
    words = json.loads(arrays["words"].tobytes().decode())
    specials = [
        Special(Kind(int(row[0])), Outcome(int(row[1])), float(row[2]), float(row[3]), text,
                int(row[4]), float(row[5]), place,
                np.array([complex(row[7], row[8]), complex(row[9], row[10])]))
        for place, row, text in zip(places[len(points):], arrays["of_special"].reshape(-1, 11),
                                    words, strict=True)]
    return tuple(points), tuple(specials), tuple(map(int, arrays["of_special"][:, 6]))


def _places(arrays: Mapping[str, NDArray[Any]]) -> list[Place]:
    ends = np.cumsum(arrays["events"])
    parts = [np.split(arrays[f"event_{name}"], ends[:-1]) for name in OF_EVENT]
    of_z = np.cumsum(2 * arrays["events"] + 1)[:-1]
    found, last = [], None
    for kind, flank, piece, arc, cycles, z, tangent in zip(
            *parts, arrays["period"].tolist(), np.split(arrays["z"], of_z),
            np.split(arrays["tangent"], of_z), strict=True):
        own = (kind, flank, piece, arc)
        # Points with the same events share a layout, as they did.
        if last is None or last.cycles != cycles or not all(
                np.array_equal(one, getattr(last, name))
                for one, name in zip(own, OF_EVENT, strict=True)):
            last = Layout(kind, flank, piece, int(cycles), arc)
        found.append(Place(last, z, tangent))
    return found
