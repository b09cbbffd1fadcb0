"""What a run wrote into a folder, and whether it is still there as it was written."""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

MANIFEST = "manifest.json"
# In a staging folder as long as it is not complete: nothing else in it is of any worth.
MAKING = ".making"
MANIFEST_FORMAT = 1
COMPLETE, INCOMPLETE = "complete", "incomplete"
CHUNK = 1 << 20


def sha256_of(path: str | Path) -> str:
    """SHA-256 (hex) of a file's content."""
    total = hashlib.sha256()
    with open(path, "rb") as file:
        while block := file.read(CHUNK):
            total.update(block)
    return total.hexdigest()


def flush(path: str | Path) -> None:
    """Have a file or the names in a folder written to the disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


@dataclass
class Manifest:
    """What a run wrote into a folder.

    Attributes
    ----------
    state : 'complete' or 'incomplete' (something is left to be computed or drawn)
    inputs : str, hash of the values that the files follow from
    program, engine : str, version, and SHA-256 of the compiled engine
    files : dict of name -> {"size": bytes, "sha256": hex}
    coming : like `files`, new contents on their way: as long as they are listed here, a file may
        have the old content or the new one, or not be there yet
    variables : dict of "/group/variable" -> SHA-256 of its numbers, of the result file
    replaced : list of str, names that were the program's in the folder before
    figures : list of str, which figures were asked for, and drawn unless `state` says otherwise;
        None in manifests that do not tell
    """

    state: str = COMPLETE
    inputs: str = ""
    program: str = ""
    engine: str = ""
    files: dict[str, dict[str, Any]] = field(default_factory=dict)
    coming: dict[str, dict[str, Any]] = field(default_factory=dict)
    variables: dict[str, str] = field(default_factory=dict)
    replaced: list[str] = field(default_factory=list)
    figures: list[str] | None = None

    @classmethod
    def of(cls, folder: Path, **facts: Any) -> Manifest:
        """List the files of a folder, which holds nothing else."""
        files = {path.name: {"size": path.stat().st_size, "sha256": sha256_of(path)}
                 for path in sorted(folder.iterdir()) if path.name not in (MANIFEST, MAKING)}
        return cls(files=files, **facts)

    @classmethod
    def read(cls, folder: str | Path) -> Manifest | None:
        """The manifest of a folder; None where there is none or it is damaged."""
        try:
            content = json.loads((Path(folder) / MANIFEST).read_text(encoding="utf-8"))
            checksum = content.pop("checksum")
            if checksum != _checksum(content) or content.pop("format") != MANIFEST_FORMAT:
                return None
            return cls(**content)
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            return None

    def own(self, folder: Path) -> set[str]:
        """Names in a folder that are the program's: what is listed, and what has come."""
        return {*self.files, *(name for name in self.coming if not self.wrong_with(folder / name))}

    def write(self, folder: Path) -> None:
        """Write it into a folder; not flushed."""
        content = {"format": MANIFEST_FORMAT, **vars(self)}
        text = json.dumps({**content, "checksum": _checksum(content)}, indent=1, sort_keys=True)
        (folder / MANIFEST).write_text(text + "\n", encoding="utf-8")

    def damaged(self, folder: str | Path) -> dict[str, str]:
        """Listed files that are not as they were written: name -> what is wrong."""
        return {name: wrong for name in self.files
                if (wrong := self.wrong_with(Path(folder) / name))}

    def wrong_with(self, path: Path) -> str:
        """What is wrong with one listed file; empty where its content is the listed one."""
        listed = [names[path.name] for names in (self.files, self.coming) if path.name in names]
        try:
            size = path.stat().st_size
            of_size = [one["sha256"] for one in listed if one["size"] == size]
            if not of_size:
                return f"{size} bytes, {listed[0]['size']} were written"
            return "" if sha256_of(path) in of_size else "its content has changed"
        except FileNotFoundError:
            return "missing"
        except OSError as error:
            return error.strerror or str(error)


def _checksum(content: dict[str, Any]) -> str:
    text = json.dumps(content, sort_keys=True, ensure_ascii=True)
    return hashlib.sha256(text.encode()).hexdigest()
