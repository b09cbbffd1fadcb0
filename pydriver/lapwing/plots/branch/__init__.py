"""Figures of the curves of branches over two parameters."""
