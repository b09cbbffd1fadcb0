"""
Run the style checks, the Fortran tests and the Python tests, and report each.

Each is run whatever the others say; with `--lint` the style checks alone.
"""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import environment
from environment import ROOT, VENV

# Which Meson file must name which sources, and how: one left out would silently not be run.
BUILD_LISTS = (
    ("fortran/meson.build", "fortran/**/*.f90", "{0.parent.name}/{0.name}'"),
    ("tests/meson.build", "tests/fortran/test_*.f90", "'{0.stem}'"),
    ("tests/reference/meson.build", "tests/reference/*.f90", "'{0.name}'"),
)
MOST_WORKERS = 8


def unlisted() -> list[str]:
    """Fortran sources that no Meson file names."""
    return [
        f"{path.relative_to(ROOT)} is not listed in {listing}"
        for listing, pattern, entry in BUILD_LISTS
        for path in sorted(ROOT.glob(pattern))
        if entry.format(path) not in (ROOT / listing).read_text()
    ]


def run(*command: str, at_end: bool = False) -> None:
    """Run a program of .venv in the checkout; CalledProcessError if it fails.

    What it says is printed as it comes, or in one piece at its end.
    """
    program = str(VENV / "bin" / command[0])
    sys.stdout.flush()
    done = subprocess.run([program, *command[1:]], cwd=ROOT, env=environment.activated(),
                          stdout=subprocess.PIPE if at_end else None,
                          stderr=subprocess.STDOUT if at_end else None, text=True)
    if at_end:
        print(done.stdout, end="", flush=True)
    done.check_returncode()


def fortran_tests() -> None:
    """Compile the Fortran tests with run-time checks, in a folder of their own, and run them."""
    with environment.sole_use(), environment.build_folder("test") as folder:
        if not Path(folder, "build.ninja").exists():
            # Each of many programs would be optimised as a whole, for a run of a second.
            run("meson", "setup", "-Dbuildtype=custom", "-Ddebug=true", "-Doptimization=1",
                "-Db_lto=false", str(folder))
        run("meson", "test", "-C", str(folder), "--print-errorlogs")


def python_tests(full: bool) -> None:
    """Run pytest on the installed package, one process for each core."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    # More of them would wait for each other at the disk, and take 300 MB each.
    workers = min(cores or 1, MOST_WORKERS)
    run("python", "-m", "pytest", "-n", str(workers), "--dist", "worksteal",
        *(["-m", "full or not full"] if full else []))


def lint() -> None:
    """Style and types of all sources; every checker speaks, each in one piece, before any fails."""
    checks = (("ruff", "check", ".", ".build"),
              ("fortitude", "check", "fortran", "tests/fortran", "tests/reference"),
              ("mypy",))
    if not all([passes(run, *command, at_end=True) for command in checks]):
        raise subprocess.CalledProcessError(1, "lint")


def passes(tests, *arguments, **options) -> bool:
    """Whether the tests pass."""
    try:
        tests(*arguments, **options)
    except subprocess.CalledProcessError:
        return False
    return True


def main() -> int:
    """Run everything; the exit status."""
    results, all_tests = {}, "--lint" not in sys.argv[1:]
    with ThreadPoolExecutor(1) as beside:
        # One slow checker beside compilers that mostly wait for each other.
        style = beside.submit(passes, lint)
        if all_tests:
            results["Fortran tests"] = passes(fortran_tests)
        results["style"] = style.result()
    if all_tests:
        results["Python tests"] = passes(python_tests, "--full" in sys.argv[1:])
        omitted = unlisted()
        for line in omitted:
            print(line)
        results["source lists"] = not omitted
    for what, passed in results.items():
        print(f"{what}: {'passed' if passed else 'FAILED'}")
    return 0 if all(results.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
