"""What a recording was, as a number: SHA-256 of its files."""

from __future__ import annotations

import hashlib
from pathlib import Path

__all__ = ["recording_digest"]


def recording_digest(path: Path) -> str:
    """SHA-256 of a file; of a folder, the SHA-256 over the names and digests of the files directly in it."""
    if not path.is_dir():
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    whole = hashlib.sha256()
    for part in sorted(p for p in path.iterdir() if p.is_file()):
        whole.update(f"{part.name}\0{recording_digest(part)}\n".encode())
    return whole.hexdigest()
