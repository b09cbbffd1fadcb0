"""The main result of each study in one line."""

from __future__ import annotations

from lapwing.base.registry import carried_out


def headlines(found, missing=()):
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
