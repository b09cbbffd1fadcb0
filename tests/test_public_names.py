"""What public calls return can be asked for by name, with words: `help(lapwing.Orbit)`."""

import importlib
import inspect
import pkgutil
import pydoc
import re
from functools import cached_property

import pytest

import lapwing

# Reached through what is public, and of no use without it; a `Path` is that of the library.
INNER = {"Asked", "CurveFit", "Follower", "Parts", "Path", "Place", "Spot", "Tracer"}


def classes():
    """Every class of the package, by its name."""
    found = {}
    for one in pkgutil.walk_packages(lapwing.__path__, "lapwing."):
        if one.name.endswith("__main__") or "._engine" in one.name:
            continue
        for name, member in vars(importlib.import_module(one.name)).items():
            if inspect.isclass(member) and member.__module__.startswith("lapwing."):
                found[name] = member
    return found


def given(public):
    """Annotations of what a function returns, or of what a class has and its methods return."""
    if not inspect.isclass(public):
        return [getattr(public, "__annotations__", {}).get("return", "")]
    found = [text for name, text in inspect.get_annotations(public).items()
             if not name.startswith("_")]
    for name, member in vars(public).items():
        function = member.fget if isinstance(member, property) else \
            member.func if isinstance(member, cached_property) else \
            getattr(member, "__func__", member)
        if not name.startswith("_") and inspect.isfunction(function):
            found.append(function.__annotations__.get("return", ""))
    return found


def test_the_classes_of_what_is_returned_are_public():
    known, public = classes(), set(lapwing.__all__) - {"__version__"}
    names = {word for name in public for text in given(getattr(lapwing, name))
             for word in re.findall(r"\w+", str(text))}
    assert {"Orbit", "Multipliers", "Run", "HybridState", "CriticalValue"} <= names
    lacking = {name for name in names & known.keys() - INNER if not name.startswith("_")
               and known[name] not in [getattr(lapwing, one) for one in public]}
    assert not lacking


@pytest.mark.parametrize("name", sorted(set(lapwing.__all__) - {"__version__"}))
def test_help_has_words_for_it(name):
    public = getattr(lapwing, name)
    assert len(pydoc.render_doc(public)) > 200
    assert inspect.getdoc(public) and public.__module__.startswith("lapwing.")
    if inspect.isclass(public):  # its own words, not those of Python's dict or Exception
        assert public.__dict__.get("__doc__")


def test_a_wrong_name_is_answered_with_near_ones():
    with pytest.raises(AttributeError, match=r"no attribute 'swep', did you mean 'sweep'\?"):
        lapwing.swep  # noqa: B018
