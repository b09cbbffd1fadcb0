"""The layers: imports go downwards only, in Fortran and in Python; the engine's own rules."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

from helpers import ROOT

# --- Fortran ----------------------------------------------------------------------------------

FORTRAN = ROOT / "fortran"
SOURCES = sorted(FORTRAN.rglob("*.f90"))
# The way of the data, and what may be imported: a room uses those before it, and itself.
ROOMS = ["base", "polynomial", "flank", "contact", "system", "flow", "flow/rk4", "flow/exact",
         "hybrid", "observers", "run", "branch", "api"]
MOST_FILES, MOST_LINES = 12, 400


@cache
def statements(path):
    """Fortran statements in lower case: no comments, no strings, continued lines joined."""
    text = re.sub(r"'[^'\n]*'|\"[^\"\n]*\"", "''", path.read_text(encoding="utf-8"))
    lines = [line.split("!")[0].strip().lower() for line in text.splitlines()]
    joined = re.sub(r"&\s*&?", "", "\n".join(line for line in lines if line).replace("&\n", "&"))
    return [part.strip() for line in joined.splitlines() for part in line.split(";")]


def uses(path):
    """(module, has only, is intrinsic) of every use statement."""
    found = [re.match(r"use\b(\s*,\s*intrinsic)?\s*(?:::)?\s*(\w+)(.*)", line)
             for line in statements(path)]
    return [(m[2], re.match(r"\s*,\s*only\s*:\s*\w", m[3]) is not None, bool(m[1]))
            for m in found if m]


def room(path):
    return path.parent.relative_to(FORTRAN).as_posix()


def module_name(path):
    """The path, without the ground floor and without saying a word twice in a row."""
    if path.stem == "api":
        return "api"
    parts = [part for part in path.relative_to(FORTRAN).with_suffix("").parts if part != "base"]
    return "_".join(["lapwing", *parts[:-1], *parts[-1:][:parts[-1:] != parts[-2:-1]]])


MODULE_ROOMS = {module_name(path): room(path) for path in SOURCES}


def test_the_build_lists_every_source_once():
    build = (FORTRAN / "meson.build").read_text(encoding="utf-8")
    listed = re.findall(r"'([\w/]+\.f90)'", build.split("engine_sources", 1)[1].split(")", 1)[0])
    assert sorted([*listed, "api/api.f90"]) == [p.relative_to(FORTRAN).as_posix() for p in SOURCES]


def test_every_source_lies_in_a_room_that_can_be_overlooked():
    assert {room(path) for path in SOURCES} == set(ROOMS)
    for name in ROOMS:
        files = list((FORTRAN / name).glob("*.f90"))
        assert len(files) <= MOST_FILES, f"{len(files)} files in {name}"
    for path in SOURCES:
        lines = path.read_text(encoding="utf-8").count("\n")
        assert lines <= MOST_LINES, f"{path.name}: {lines} lines"


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: p.name)
def test_a_file_is_one_module_named_after_it(path):
    modules = [line for line in statements(path) if re.match(r"module \w+$", line)]
    assert modules == [f"module {module_name(path)}"]
    assert not any(re.match(r"(program|submodule)\b", line) for line in statements(path))


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: p.name)
def test_use_goes_downwards_and_names_what_it_takes(path):
    for module, only, intrinsic in uses(path):
        assert only, f"use {module} without only"
        if intrinsic or module in ("iso_c_binding", "iso_fortran_env", "ieee_arithmetic",
                                   "omp_lib"):
            continue
        assert ROOMS.index(MODULE_ROOMS[module]) <= ROOMS.index(room(path)), \
            f"{module_name(path)} uses {module}"
        assert {room(path), MODULE_ROOMS[module]} != {"flow/rk4", "flow/exact"}, \
            f"{module_name(path)} uses {module}: two ways to move know nothing of each other"


def test_the_api_is_used_by_nobody_and_sees_the_marshal_only():
    assert not any(module == "api" for path in SOURCES for module, _, _ in uses(path))
    assert {m for m, _, i in uses(FORTRAN / "api/api.f90") if not i} \
        == {"lapwing_api_branches", "lapwing_api_marshal"}


def test_the_automaton_and_all_behind_it_know_no_oscillator():
    """They serve any system; the sweep and the marshal make one."""
    for path in SOURCES:
        if room(path) in ("flow/rk4", "observers"):
            assert "lapwing_system_oscillator" not in {m for m, _, _ in uses(path)}, path.name


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: p.name)
def test_every_module_is_private_and_typed(path):
    head = _module_head(path)
    assert "implicit none" in head or "implicit none (type, external)" in head
    assert "private" in head
    assert any(re.match(r"public\s*::", line) for line in head)
    assert "public" not in head


def _module_head(path):
    """Statements of the specification part of the module."""
    lines = statements(path)
    end = lines.index("contains") if "contains" in lines else len(lines)
    # The first `contains` may be one of a derived type.
    depth, head = 0, []
    for i, line in enumerate(lines):
        depth += bool(re.match(r"type\b(?!\s*\()", line)) - bool(re.match(r"end type", line))
        if line == "contains" and depth == 0:
            end = i
            break
        head.append(line)
    return head[:max(end, 0)]


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: p.name)
def test_no_module_variables_but_parameters(path):
    depth = 0
    for line in _module_head(path):
        depth += bool(re.match(r"(abstract )?interface\b", line)) - bool(
            re.match(r"end interface", line))
        is_type = bool(re.match(r"type\b(?!\s*\()", line))
        depth += is_type - bool(re.match(r"end type", line))
        if depth or is_type or not re.match(
                r"(integer|real|logical|complex|character|type\s*\(|class\s*\()", line):
            continue
        assert "parameter" in line.split("::")[0], f"module variable: {line}"


# Each pattern is looked for at the beginning of a statement, after `if (...)` as well.
FORBIDDEN = {
    "input or output": r"(print\b|write\s*\(|read\s*\(|open\s*\(|close\s*\(|inquire\s*\()",
    "stop": r"(error\s+)?stop\b", "save": r"save\b", "common": r"common\b", "go to": r"go\s*to\b",
    "pause": r"(pause|entry|equivalence)\b"}


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: p.name)
def test_the_engine_neither_talks_nor_stops(path):
    for line in statements(path):
        for what, pattern in FORBIDDEN.items():
            assert not re.match(rf"(if\s*\(.*\)\s*)?{pattern}", line), (what, line)


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: p.name)
def test_no_local_is_saved(path):
    """An initialised local variable of a procedure has the save attribute (trap 7)."""
    head = len(_module_head(path))
    for line in statements(path)[head:]:
        declared = re.match(r"(integer|real|logical|type\s*\()[^:]*::(.*)", line)
        if declared and "parameter" not in line.split("::")[0]:
            outside = re.sub(r"\([^()]*\)", "", declared[2])
            assert "=" not in outside, line
        assert not re.search(r",\s*save\b", line.split("::")[0]), line


def test_dummies_have_an_intent():
    """Every argument of every procedure is declared with intent (or is a passed procedure)."""
    for path in SOURCES:
        lines = statements(path)
        for i, line in enumerate(lines):
            head = re.match(r"(?:[\w() ,=]*\s)?(?:subroutine|function)\s+\w+\s*\(([^)]*)\)", line)
            if not head or line.startswith("end"):
                continue
            names = {name.strip() for name in head[1].split(",") if name.strip()}
            with_intent, others = set(), set()
            for later in lines[i + 1:]:
                if re.match(r"end (subroutine|function)", later) or later == "contains":
                    break
                declared = re.match(r"(.*?)::(.*)", later)
                if not declared:
                    continue
                found = set(re.findall(r"\w+", re.sub(r"\([^()]*\)", "", declared[2])))
                target = re.search(r"intent\s*\(|procedure\s*\(", declared[1])
                (with_intent if target else others).update(found)
            assert names <= with_intent, f"{path.name}: {line}: {names - with_intent}"


# --- Python -----------------------------------------------------------------------------------

PACKAGE = ROOT / "pydriver" / "lapwing"
MODULES = sorted(PACKAGE.rglob("*.py"))
# Lowest first: a room imports from those above it in this list, and from itself; rooms of one row
# know nothing of each other. What lies loose in the package, and `commands`, is the command line.
PYTHON_ROOMS = [{"base"}, {"model"}, {"deck"}, {"engine"}, {"results"}, {"studies"},
                {"report", "plots"}]
LOOSE = [{"executors", "folder", "progress", "console", "accessor"}, {"run", "part", "drawing"},
         {"commands"}, {"cli"}, {"__main__"}]


def rank(name):
    """How high the room of a module lies, by the module's first part."""
    first = name.split(".")[0]
    for height, names in enumerate(PYTHON_ROOMS + LOOSE):
        if first in names:
            return height
    raise AssertionError(f"module {name!r} lies in no room")


def test_the_rooms_are_those_of_the_tree():
    folders = {path.parent.relative_to(PACKAGE).parts[0] for path in MODULES
               if path.parent != PACKAGE}
    assert folders == set().union(*PYTHON_ROOMS) | {"commands"}
    loose = {path.stem for path in PACKAGE.glob("*.py")} - {"__init__", "_build_info"}
    assert loose == set().union(*LOOSE) - {"commands"}


def test_every_room_can_be_overlooked():
    for folder in {path.parent for path in MODULES}:
        files = list(folder.glob("*.py"))
        assert (folder / "__init__.py") in files, f"{folder.name} is no package"
        assert len(files) <= MOST_FILES, f"{len(files)} files in {folder.name}"
    for path in MODULES:
        lines = path.read_text(encoding="utf-8").count("\n")
        assert lines <= MOST_LINES, f"{own_name(path)}: {lines} lines"


def test_the_tests_mirror_the_source():
    """A folder of tests is named after a room, or holds what a test needs."""
    others = {"bench", "fortran", "hard_cases", "reference", "accepted", "refused", "tables",
              "snippets"}
    rooms = {path.parent.relative_to(PACKAGE).as_posix() for path in MODULES}
    for path in (ROOT / "tests").rglob("test_*.py"):
        room = path.parent.relative_to(ROOT / "tests").as_posix()
        assert room in rooms or room.split("/")[0] in others, f"{room} is no room"


def own_name(path):
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@cache
def parsed(path):
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def imports(path):
    """(module, at the top of the file) of every import, package parts spelled out."""
    return list(_imports(path))


def _imports(path):
    tree = parsed(path)
    top = {id(node) for node in tree.body}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name, id(node) in top
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            if node.module == "lapwing":
                for alias in node.names:
                    yield f"lapwing.{alias.name}", id(node) in top
            else:
                yield node.module, id(node) in top


@pytest.mark.parametrize("path", MODULES, ids=own_name)
def test_imports_go_downwards(path):
    name = own_name(path)
    if not name:  # the package's own __init__ loads by name, on demand
        assert [m for m, _ in imports(path)] == ["importlib"]
        return
    for module, _ in imports(path):
        if not module.startswith("lapwing.") or module.startswith("lapwing._"):
            continue
        target = module.removeprefix("lapwing.")
        same_room = target.split(".")[0] == name.split(".")[0]
        assert rank(target) < rank(name) or same_room, f"{name} imports {target}"


def public(tree):
    """(name, node) of the classes and functions of a module without an underscore, and methods."""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
            yield node.name, node
            if isinstance(node, ast.ClassDef):
                yield from ((f"{node.name}.{name}", one) for name, one in public(node))


def lacks_annotation(function):
    """Names of its arguments without an annotation, 'return' for what it gives."""
    args = function.args
    plain = [*args.posonlyargs, *args.args, *args.kwonlyargs,
             *(one for one in (args.vararg, args.kwarg) if one)]
    lacking = [one.arg for place, one in enumerate(plain) if one.annotation is None
               and not (place == 0 and one.arg in ("self", "cls"))]
    return lacking + ["return"] * (function.returns is None)


@pytest.mark.parametrize("path", MODULES, ids=own_name)
def test_public_names_say_what_they_take_give_and_are(path):
    """Annotations throughout, private functions included, and a docstring for each public name."""
    tree = parsed(path)
    bare = {node.name: lacking for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)
            if (lacking := lacks_annotation(node))}
    assert not bare
    assert not [name for name, node in public(tree) if not ast.get_docstring(node)]


def test_the_engine_has_one_importer():
    importers = {own_name(path) for path in MODULES
                 for module, _ in imports(path) if module.startswith("lapwing._engine")}
    assert importers == {"engine.compiled"}


@cache
def for_types(path):
    """Modules that are imported for annotations alone: no program loads them for that."""
    tree = parsed(path)
    return {node.module for block in tree.body
            if isinstance(block, ast.If) and ast.unparse(block.test) == "TYPE_CHECKING"
            for node in block.body if isinstance(node, ast.ImportFrom)}


def test_the_heavy_packages_are_imported_where_they_are_used():
    """matplotlib only under plots; it, xarray and scipy never at the top of a module."""
    for path in MODULES:
        for module, at_top in imports(path):
            package = module.split(".")[0]
            if package == "matplotlib" and module not in for_types(path):
                assert own_name(path).startswith("plots")
            if package in ("matplotlib", "xarray", "scipy", "netCDF4", "pandas"):
                assert not at_top, f"{own_name(path)} imports {module} at its top"


def test_plots_know_neither_engine_nor_studies():
    for path in (PACKAGE / "plots").rglob("*.py"):
        for module, _ in imports(path):
            assert not re.match(r"lapwing\.(engine|studies|_engine|simulate|sweep)", module)


def test_the_package_knows_the_benchmark_by_its_command_only():
    known = {(own_name(path), module) for path in MODULES for module, _ in imports(path)
             if module.split(".")[0] == "lapwing_bench"}
    assert known == {("cli", "lapwing_bench.command_line")}


def test_modules_do_not_form_a_ring():
    """Imports of names count for the module that has the name; packages only gather them.

    What is imported for annotations alone is never loaded for them: it makes no ring.
    """
    names = {own_name(path) for path in MODULES if path.name != "__init__.py"}
    graph = {}
    for path in MODULES:
        tree = parsed(path)
        found = {f"{node.module}.{alias.name}".removeprefix("lapwing.")
                 for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)
                 for alias in node.names}
        found |= {module.removeprefix("lapwing.") for module, _ in imports(path)
                  if module not in for_types(path)}
        graph[own_name(path)] = found & names
    done = set()

    def reach(name, way):
        assert name not in way, f"ring through {name}"
        if name not in done:
            for target in graph[name]:
                reach(target, (*way, name))
            done.add(name)

    for name in names:
        reach(name, ())


def test_the_checks_see_what_they_should(tmp_path):
    """The readers above find what they look for in a file that breaks every rule."""
    bare = ast.parse("class A:\n  def f(self, x: int, *y): ...\n  def _g(self): ...\n")
    (_, _), (name, method) = public(bare)
    assert (name, lacks_annotation(method)) == ("A.f", ["y", "return"])
    bad = Path(tmp_path) / "bad.f90"
    bad.write_text("module lapwing_bad\n  use lapwing_run\n  use, intrinsic :: iso_c_binding, &\n"
                   "    only: c_int\n  integer :: counter = 0\ncontains\n  subroutine s(a)\n"
                   "    real :: a\n    if (a > 0) error stop 'no'\n  end subroutine\nend module\n")
    assert uses(bad) == [("lapwing_run", False, False), ("iso_c_binding", True, True)]
    with pytest.raises(AssertionError, match="module variable"):
        test_no_module_variables_but_parameters(bad)
    with pytest.raises(AssertionError, match="stop"):
        test_the_engine_neither_talks_nor_stops(bad)
    with pytest.raises(AssertionError):
        test_every_module_is_private_and_typed(bad)
