"""Recordings of every known kind, read by gpcorrect and by independent readers, and compared value by value.

The files are written to the formats' published descriptions by code that shares nothing with the readers of gpcorrect
(bench/formats); the independent readers are ezc3d, c3d, rosbags, mcap, scipy.io, h5py and pandas. Times must agree to
1 us, positions to 1 um (the files hold nine digits at best), rotations to 10 urad, and the same samples must be
missing. Exit status 1 where a file is refused or a value differs.

Run it with: pip install 'gpcorrect[all,readers]'; python bench/readers.py
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np
from formats.cases import Case, all_cases
from formats.oracles import Seen

from gpcorrect.errors import GpCorrectError
from gpcorrect.logs import read_log
from gpcorrect.types import CalibrationLog

TIME, POSITION, ROTATION = 1e-6, 1e-6, 1e-5  # s, m, rad; the text files hold six to nine digits


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("words", nargs="*", help="only kinds with one of these words in their name")
    words = parser.parse_args().words
    cases = [case for case in all_cases() if not words or any(word in case.kind for word in words)]
    read = agree = 0
    print(f"{'kind':44} {'read':>5} {'agrees':>7}  what differs, or why it was refused")
    for case in cases:
        with tempfile.TemporaryDirectory() as folder:
            log, why = read_case(case, Path(folder))
        read += log is not None
        agree += log is not None and not why
        print(f"{case.kind:44} {'yes' if log else 'NO':>5} {'yes' if log and not why else 'NO':>7}  {why}", flush=True)
    print(f"{len(cases)} kinds: {read} read, {agree} agree, {len(cases) - read} wrongly refused")
    return int(agree < len(cases))


def read_case(case: Case, folder: Path) -> tuple[CalibrationLog | None, str]:
    """Read a file of a kind; what differs from the independent reader is said."""
    path = case.write(folder)
    mapping = None
    if case.mapping:
        mapping = folder / "map.toml"
        mapping.write_text(case.mapping)
    try:
        log = read_log(path, columns=mapping, **case.options)
    except GpCorrectError as error:
        return None, str(error)
    return log, difference(log, case.oracle(path))


def difference(log: CalibrationLog, seen: Seen) -> str:
    """Say what differs; empty where all values agree."""
    pose = getattr(log, seen.signal)
    if len(log) != len(seen.position):
        return f"{len(log)} samples instead of {len(seen.position)}"
    missing, expected = np.isnan(pose.position).any(axis=1), np.isnan(seen.position).any(axis=1)
    if (missing != expected).any():
        return f"{(missing != expected).sum()} samples missing in one only"
    late = np.abs((log.time - log.time[0]) - (seen.time - seen.time[0])).max()
    off = np.abs(pose.position - seen.position)[~missing].max()
    said = [f"time by {late:.2g} s"] if late > TIME else []
    said += [f"position by {off:.2g} m"] if off > POSITION else []
    if (pose.quaternion is None) != (seen.rotation is None):
        said.append("orientation in one only")
    elif seen.rotation is not None:
        angle = np.abs(turns(pose.quaternion[~missing], seen.relative) - turns(seen.rotation[~missing], seen.relative))
        said += [f"rotation by {angle.max():.2g} rad"] if not angle.max() <= ROTATION else []
    return ", ".join(said)


def turns(rotation: np.ndarray, relative: bool) -> np.ndarray:
    """Rotation matrices of quaternions wxyz or of matrices, from the first one on where that is all that is known."""
    if rotation.ndim == 2:
        w, x, y, z = (rotation / np.linalg.norm(rotation, axis=1, keepdims=True)).T
        rows = [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)]
        rows += [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)]
        rows += [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]
        rotation = np.stack(rows, axis=1).reshape(-1, 3, 3)
    return rotation @ rotation[0].T if relative else rotation


if __name__ == "__main__":
    sys.exit(main())
