"""What Lapwing needs from the operating system: tested by use, installed where it is missing."""

import os
import shlex
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path

# Whatever changes what the compilers make of the same sources.
COMPILER_VARIABLES = ("FC", "FFLAGS", "CC", "CFLAGS", "CPPFLAGS", "LDFLAGS")

# OpenMP and a run-time call: a compiler without its library links neither.
FORTRAN_PROBE = """\
program probe
  use, intrinsic :: iso_fortran_env, only: real64
  use omp_lib, only: omp_get_max_threads
  implicit none
  real(real64) :: x(2)
  x = sqrt([real(real64) :: 1, 4])
  if (nint(sum(x)) /= 3 .or. omp_get_max_threads() < 1) error stop
end program probe
"""

C_PROBE = """\
#include <stdio.h>
int main(void) { return puts("") < 0; }
"""

HEADER_PROBE = """\
#include <Python.h>
int main(void) { return PY_MAJOR_VERSION != 3; }
"""


class Missing(Exception):
    """Something that set-up cannot provide by itself; the text tells the user what to do."""


def interpreter() -> str:
    """Path of the interpreter in use; its base if this is a virtual environment's."""
    return os.path.realpath(getattr(sys, "_base_executable", sys.executable))


def fortran_compiler() -> str:
    """The Fortran compiler as the user chose it."""
    return os.environ.get("FC") or "gfortran"


def c_compiler() -> str:
    """The C compiler as the user chose it."""
    return os.environ.get("CC") or "cc"


def fingerprint() -> dict:
    """Everything about compilers and flags that calls for a new build when it changes."""
    names = (fortran_compiler(), c_compiler())
    found = [shutil.which((shlex.split(name) or [""])[0]) for name in names]
    return {
        "variables": {name: os.environ.get(name, "") for name in COMPILER_VARIABLES},
        "compilers": [os.path.realpath(path) if path else None for path in found],
    }


def builds(compiler: str, suffix: str, source: str, *options: str) -> bool:
    """Whether the compiler makes a program of the source, and the program runs."""
    with tempfile.TemporaryDirectory() as folder:
        probe = Path(folder, "probe" + suffix)
        probe.write_text(source)
        program = str(Path(folder, "probe"))
        try:
            for command in (
                [*shlex.split(compiler), *options, str(probe), "-o", program],
                [program],
            ):
                subprocess.run(command, check=True, capture_output=True, cwd=folder)
        except (OSError, subprocess.CalledProcessError):
            return False
    return True


def has_fortran() -> bool:
    """Whether the Fortran compiler makes programs that run."""
    return builds(fortran_compiler(), ".f90", FORTRAN_PROBE, "-fopenmp")


def has_c() -> bool:
    """Whether the C compiler makes programs that run."""
    return builds(c_compiler(), ".c", C_PROBE)


def has_headers() -> bool:
    """Whether the interpreter in use has its C headers (needs a C compiler to tell for sure)."""
    include = sysconfig.get_path("include")
    if not has_c():
        return Path(include, "Python.h").exists()
    platform_include = sysconfig.get_path("platinclude")
    return builds(c_compiler(), ".c", HEADER_PROBE, "-I" + include, "-I" + platform_include)


def make_venv(folder: Path) -> bool:
    """Make a virtual environment; False (and no folder) if the interpreter cannot."""
    shutil.rmtree(folder, ignore_errors=True)
    python = folder / "bin" / "python"
    try:
        for command in (
            [interpreter(), "-m", "venv", str(folder)],
            [str(python), "-m", "pip", "--version"],
        ):
            subprocess.run(command, check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        # Without ensurepip, venv fails and still leaves a bin/python behind.
        shutil.rmtree(folder, ignore_errors=True)
        return False
    return True


def belongs_to_debian() -> bool:
    """Whether apt-get has packages for the interpreter in use."""
    return Path("/etc/debian_version").exists() and interpreter().startswith("/usr/bin/")


def wanted_packages(venv: Path | None) -> dict[str, list[str]]:
    """
    Name what fails when used, and the Debian packages that provide it.

    Parameters
    ----------
    venv : Path or None
        Virtual environment to make on the way; None if there is one already.

    Returns
    -------
    dict
        Packages by what they are for; an empty list where no package can help.
    """
    debian_python = "python{}.{}".format(*sys.version_info) if belongs_to_debian() else None
    wanted = {}
    if not has_fortran():
        # libc6-dev is only recommended by the compilers; nothing links without it.
        packages = [] if os.environ.get("FC") else ["gfortran", "libc6-dev"]
        wanted[f"the Fortran compiler {fortran_compiler()} with OpenMP"] = packages
    if not has_c():
        wanted[f"the C compiler {c_compiler()}"] = (
            [] if os.environ.get("CC") else ["gcc", "libc6-dev"]
        )
    if not has_headers():
        wanted[f"Python.h of {interpreter()}"] = [f"{debian_python}-dev"] if debian_python else []
    if venv and not make_venv(venv):
        wanted[f"venv and pip of {interpreter()}"] = (
            [f"{debian_python}-venv"] if debian_python else []
        )
    return wanted


def apt_commands(packages: list[str]) -> list[list[str]]:
    """Commands that install the packages, waiting for another apt-get if need be."""
    apt = ["apt-get", "-o", "DPkg::Lock::Timeout=300"]
    return [
        [*apt, "update", "-qq"],
        [*apt, "install", "-y", "-qq", "--no-install-recommends", *packages],
    ]


def privilege() -> list[str] | None:
    """Command prefix that gives root's rights without asking; None if there is none."""
    if os.geteuid() == 0:
        return []
    try:
        subprocess.run(["sudo", "-n", "true"], check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    return ["sudo", "-n"]


def provide(venv: Path | None) -> None:
    """
    Make the compilers, the headers and (if asked) a new virtual environment available.

    Parameters
    ----------
    venv : Path or None
        Virtual environment to make from scratch; None keeps the one there is.

    Raises
    ------
    Missing
        With the one line to run, or with what cannot be installed at all.
    """
    wanted = wanted_packages(venv)
    if not wanted:
        return
    beyond_help = [what for what, packages in wanted.items() if not packages]
    if beyond_help or not shutil.which("apt-get"):
        raise Missing("needed, but does not work here: " + "; ".join(beyond_help or wanted))
    packages = sorted({name for names in wanted.values() for name in names})
    prefix = privilege()
    if prefix is None:
        line = "sudo apt-get update && sudo apt-get install -y --no-install-recommends"
        raise Missing(f"run this once, then try again:\n\n  {line} {' '.join(packages)}\n")
    print("installing", *packages, flush=True)
    for command in apt_commands(packages):
        command = [*prefix, "env", "DEBIAN_FRONTEND=noninteractive", *command]
        subprocess.run(command, check=True, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    still = wanted_packages(venv)
    if still:
        raise Missing("installed, but still does not work: " + "; ".join(still))
