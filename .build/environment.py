"""
Make .venv ready: dependencies from the lock file, and Lapwing itself built from this checkout.

Two stamps say what .venv holds; each is written last, after the step it vouches for:

* `dependencies`: interpreter, lock file and place. Differs or absent: .venv is made from scratch.
* `package`: sources and compilers as well. Differs or absent: only Lapwing is built and installed.

So whatever interrupts a set-up, the next one takes it up again. When both fit, nothing is done.
"""

import contextlib
import fcntl
import hashlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import toolchain

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / ".venv"
BUILD = ROOT / "build"
LOCK_FILE = ROOT / ".build" / "requirements.txt"
# What goes into the installed package, or decides how it is built.
PACKAGE_SOURCES = ("fortran", "pydriver", "meson.build", "meson.options", "pyproject.toml",
                   "LICENSE", "README.md")


def digest(paths) -> str:
    """Hash of names and contents of files, and of all files in folders."""
    total = hashlib.sha256()
    for path in map(Path, paths):
        files = sorted(path.rglob("*")) if path.is_dir() else [path]
        for file in files:
            if file.is_file() and "__pycache__" not in file.parts:
                total.update(f"{file.relative_to(ROOT)}\0{file.stat().st_size}\0".encode())
                total.update(file.read_bytes())
    return total.hexdigest()


def dependencies_key() -> dict:
    """What the dependencies in .venv depend on; the place because a venv cannot be moved."""
    return {
        "venv": str(VENV),
        "interpreter": toolchain.interpreter(),
        "version": sys.version,
        "lock": digest([LOCK_FILE]),
    }


def package_key() -> dict:
    """What the installed package depends on besides its dependencies."""
    return {
        "sources": digest(ROOT / name for name in PACKAGE_SOURCES),
        "toolchain": toolchain.fingerprint(),
    }


def stamped(name: str, key: dict) -> bool:
    """Whether .venv carries this stamp with this key, and its interpreter still exists."""
    try:
        stamp = json.loads((VENV / f"{name}.stamp").read_text())
    except (OSError, ValueError):
        return False
    return stamp == key and (VENV / "bin" / "python").exists()


def write_stamp(name: str, key: dict) -> None:
    """Vouch for what has just been finished."""
    draft = VENV / f"{name}.draft"
    draft.write_text(json.dumps(key, indent=1))
    draft.replace(VENV / f"{name}.stamp")


def ready() -> bool:
    """Whether nothing is left to do."""
    return stamped("dependencies", dependencies_key()) and stamped("package", package_key())


@contextlib.contextmanager
def build_folder(name: str):
    """
    Lend a folder that keeps what is compiled between runs.

    It is emptied first if it was made with other compilers, options or another environment, or if
    the run before was cut short in it: half-written files are not worth diagnosing. An error that
    the build itself reports leaves it usable.
    """
    folder = BUILD / name
    state = BUILD / f"{name}.state"
    # Meson knows no option that came after the folder was made.
    options = digest([ROOT / "meson.options"])
    key = json.dumps([dependencies_key(), toolchain.fingerprint(), options])
    if not state.exists() or state.read_text() != key:
        shutil.rmtree(folder, ignore_errors=True)
    BUILD.mkdir(exist_ok=True)
    state.unlink(missing_ok=True)
    try:
        yield folder
    except subprocess.CalledProcessError as error:
        if error.returncode > 0:
            state.write_text(key)
        raise
    state.write_text(key)


@contextlib.contextmanager
def sole_use():
    """
    Let one set-up work in this checkout at a time.

    pip inherits the lock, so that one which outlives a killed set-up is waited for.
    """
    BUILD.mkdir(exist_ok=True)
    with open(BUILD / "lock-set-up", "w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            print("waiting for another set-up in this checkout", flush=True)
            fcntl.flock(file, fcntl.LOCK_EX)
        yield file.fileno()


def activated() -> dict[str, str]:
    """Environment variables with .venv leading the search path: Meson is found by name only."""
    return os.environ | {"PATH": f"{VENV / 'bin'}{os.pathsep}{os.environ.get('PATH', '')}"}


def pip_install(lock: int, *arguments: str) -> None:
    """Run pip of .venv quietly."""
    pip = [str(VENV / "bin" / "python"), "-m", "pip", "--disable-pip-version-check", "install"]
    command = [*pip, "--quiet", *arguments]
    subprocess.run(command, check=True, cwd=ROOT, env=activated(), pass_fds=[lock])


def set_up(lock: int) -> None:
    """Bring .venv up to date."""
    key = dependencies_key()
    fresh = not stamped("dependencies", key)
    if fresh:
        print(f"setting up .venv (Python {sys.version.split()[0]})", flush=True)
    toolchain.provide(VENV if fresh else None)
    if fresh:
        # Most of their modules are loaded by nobody: Python compiles the others when they are.
        pip_install(lock, "--no-compile", "--require-hashes", "--no-deps", "-r", str(LOCK_FILE))
        write_stamp("dependencies", key)

    key = package_key()
    (VENV / "package.stamp").unlink(missing_ok=True)
    print("building Lapwing", flush=True)
    with build_folder("package") as folder:
        options = ["--no-build-isolation", "--no-deps", "--force-reinstall"]
        # Spelled out: pip 23.0, which Debian 12 puts into a venv, does not know the short -C.
        options.append(f"--config-settings=build-dir={folder.relative_to(ROOT)}")
        options.append("--config-settings=setup-args=-Dbench=true")
        pip_install(lock, *options, ".")
    write_stamp("package", key)


def main() -> int:
    """Set up if need be; the exit status."""
    if ready():
        return 0
    try:
        with sole_use() as lock:
            if not ready():
                set_up(lock)
    except toolchain.Missing as error:
        print(f"Lapwing's set-up: {error}", file=sys.stderr)
        return 1
    except subprocess.CalledProcessError as error:
        print(f"Lapwing's set-up failed in: {' '.join(error.cmd)}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
