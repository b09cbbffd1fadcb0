"""Transmission error of one mesh period: the table, what it is made from, and its algebra."""

from lapwing.model.transmission_error.file import TransmissionErrorFileError
from lapwing.model.transmission_error.table import TransmissionError

__all__ = ["TransmissionError", "TransmissionErrorFileError"]
