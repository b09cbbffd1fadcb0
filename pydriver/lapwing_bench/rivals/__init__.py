"""What a user would pick instead, each as a skilled user would write it.

Every rival is a module with a function `follower(scene, tolerance)`; it returns a callable
`follow(problem, cycles)` that gives a `Record`, with everything prepared that does not depend
on the torque. Those fast enough for a sweep have `sweeper(scene, tolerance, threads)` besides: a
callable `sweep(problems, cycles)` that gives a `Record` of each torque, several at a time. Modules
import their package at the top, so they are imported by name, on demand.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version


@dataclass(frozen=True)
class Rival:
    """One method of the comparison.

    Parameters
    ----------
    name : str, as the report prints it
    module : str, in this package
    package : str, distribution it needs
    tolerances : tuple of float, from loose to tight
    slow : bool, whether a Python right-hand side makes it too slow to run every torque long
    variant : str, what its module is told besides
    sweepers : tuple of str, modules of this package with a `sweeper`
    """

    name: str
    module: str
    package: str
    tolerances: tuple
    slow: bool
    variant: str = ""
    sweepers: tuple[str, ...] = ()

    @property
    def installed(self):
        """Version of the package, or None."""
        try:
            return version(self.package)
        except PackageNotFoundError:
            return None

    def follower(self, scene, tolerance):
        """See the package's docstring."""
        module = import_module(f"lapwing_bench.rivals.{self.module}")
        arguments = (self.variant,) if self.variant else ()
        return module.follower(scene, tolerance, *arguments)

    def sweeper(self, module, scene, tolerance, threads):
        """See the package's docstring; `module` is one of `sweepers`."""
        return import_module(f"lapwing_bench.rivals.{module}").sweeper(scene, tolerance, threads)


DECADES = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
RIVALS = (
    Rival("heyoka", "heyoka_taylor", "heyoka", (1e-6, 1e-9, 1e-12, 2.2e-16), False,
          sweepers=("heyoka_taylor", "heyoka_batch")),
    Rival("numba DOPRI5", "numba_dopri5", "numba",
          (1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12), False,
          sweepers=("numba_dopri5",)),
    Rival("CVODE", "sundae_cvode", "scikit-sundae", (1e-4, 1e-6, 1e-8, 1e-10), True),
    Rival("SciPy RK45", "scipy_events", "scipy", DECADES, True, "RK45"),
    Rival("SciPy DOP853", "scipy_events", "scipy", DECADES, True, "DOP853"),
    Rival("SciPy LSODA", "scipy_events", "scipy", DECADES, True, "LSODA"),
)
