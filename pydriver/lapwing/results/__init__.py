"""Results: the file that a run writes, what is in it, and the folder in which it is kept."""

from lapwing.results.checksums import DamagedFile, checksums
from lapwing.results.file import (
    Results,
    engine_digest,
    provenance,
    read_results,
    stored_studies,
    verify,
    write_results,
)
from lapwing.results.schema import SCHEMA_VERSION
from lapwing.results.variables import CODES, DESCRIPTIONS, FAILED, VELOCITY, WHOLE, described

__all__ = ["CODES", "DESCRIPTIONS", "FAILED", "SCHEMA_VERSION", "VELOCITY", "WHOLE",
           "DamagedFile", "Results", "checksums", "described", "engine_digest", "provenance",
           "read_results", "stored_studies", "verify", "write_results"]
