"""Curves over two parameters: where the special points of branches lie."""

from lapwing.studies.curve.run import Curve, curve
from lapwing.studies.curve.trace import Meeting

__all__ = ["Curve", "Meeting", "curve"]
