"""Branches of periodic motions: continued in a parameter, with what creates and ends them."""

from lapwing.studies.branch.family import branches
from lapwing.studies.branch.run import Branch, branch
from lapwing.studies.branch.special import Kind, Outcome, Point, Special

__all__ = ["Branch", "Kind", "Outcome", "Point", "Special", "branch", "branches"]
