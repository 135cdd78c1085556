from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from read_support import assert_same_log, random_log, write
from scipy.io import savemat

from gpcorrect import se3
from gpcorrect.errors import LogError, MissingExtraError
from gpcorrect.logs import matlab, read_log
from gpcorrect.logs.columns import ReadSettings
from gpcorrect.types import CalibrationLog

N = 30


def write_73(path: Path, content: dict[str, Any]) -> Path:
    """Write the layout of MATLAB's version 7.3: a 512-byte header before HDF5, directions reversed, classes as text."""
    with h5py.File(path, "w", userblock_size=512) as file:
        _put(file, content)
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Sat Nov 21 09:00:00 2026 HDF5 schema 1.00 ."
    raw = bytearray(path.read_bytes())
    raw[:128] = head.ljust(124) + b"\x00\x02IM"
    return write(path, bytes(raw))


def _put(group: Any, content: dict[str, Any]) -> None:
    for name, value in content.items():
        if isinstance(value, dict):
            _put(group.create_group(name), value)
            group[name].attrs["MATLAB_class"] = np.bytes_("struct")
        elif isinstance(value, str):
            data = group.create_dataset(name, data=np.frombuffer(value.encode("utf-16-le"), np.uint16)[:, None])
            data.attrs["MATLAB_class"] = np.bytes_("char")
        else:
            array = np.atleast_2d(np.asarray(value, dtype=np.float64))
            data = group.create_dataset(name, data=array.T)
            data.attrs["MATLAB_class"] = np.bytes_("double")


def write_5(path: Path, content: dict[str, Any]) -> Path:
    """Write version 5, compressed as MATLAB does it."""
    savemat(path, content, do_compression=True)
    return path


WRITERS = pytest.mark.parametrize("writer", [write_5, write_73], ids=["v5", "v7.3"])


def variables(log: CalibrationLog, *, wide: bool) -> dict[str, np.ndarray]:
    """Signals as MATLAB users keep them: samples down the columns, or along the rows when `wide`."""
    content: dict[str, np.ndarray] = {"time": log.time[:, None], "trajectory": log.trajectory[:, None]}
    content["session"] = log.session[:, None]
    for name in log.POSES:
        pose = getattr(log, name)
        content[name] = np.hstack([pose.position, pose.quaternion])
    content |= {name: getattr(log, name) for name in log.JOINTS}
    content |= {name: getattr(log, name)[:, None] for name in log.SCALARS}
    content |= {"empty_one": log.extra["empty"][:, None]}
    return {name: values.T if wide else values for name, values in content.items()}


@WRITERS
@pytest.mark.parametrize("wide", [False, True])
@pytest.mark.parametrize("struct", [False, True])
def test_a_log_saved_by_matlab_is_the_log(tmp_path: Path, writer, wide: bool, struct: bool):
    """Samples along either direction, variables alone or in one structure: bit for bit the same."""
    log = random_log(0, n=N)
    content = variables(log, wide=wide)
    back = read_log(writer(tmp_path / "a.mat", {"log": content} if struct else content))
    assert back.extra.keys() == {"empty_one"}
    expected = random_log(0, n=N)
    object.__setattr__(expected, "extra", dict(back.extra))
    object.__setattr__(expected, "meta", back.meta)
    assert_same_log(back, expected)


@WRITERS
def test_transforms_become_poses(tmp_path: Path, writer):
    """A stack of 4 x 4 matrices, the samples last as MATLAB keeps them."""
    log = random_log(1, n=N)
    T = se3.from_parts(log.setpoint_cp.position, log.setpoint_cp.quaternion)
    content = {"time": log.time[:, None], "setpoint_cp": np.moveaxis(T, 0, 2)}
    back = read_log(writer(tmp_path / "a.mat", content))
    np.testing.assert_allclose(back.setpoint_cp.position, log.setpoint_cp.position, atol=1e-15)
    same = np.abs((back.setpoint_cp.quaternion * log.setpoint_cp.quaternion).sum(axis=1))
    np.testing.assert_allclose(same, 1, atol=1e-12)


@WRITERS
def test_a_mapping_names_columns_of_foreign_variables(tmp_path: Path, writer):
    """A matrix is its columns counted from one, a field of a structure is dotted; text and scalars are left out."""
    rng = np.random.default_rng(2)
    marker, stamp = rng.normal(size=(3, N)), np.arange(N) * 1e3
    content = {"meta": {"gain": 2.0, "who": "lab"}, "run": {"t_ms": stamp, "marker": marker}, "rate": 100.0}
    path = writer(tmp_path / "a.mat", content)
    text = 'time = "run.t_ms"\ntime_scale = 1e-3\n[tracker_cp]\n'
    text += 'position = ["run.marker_1", "run.marker_2", "run.marker_3"]\nposition_scale = 1e-3\n'
    log = read_log(path, columns=write(tmp_path / "m.toml", text))
    np.testing.assert_allclose(log.tracker_cp.position, 1e-3 * marker.T, rtol=1e-15)
    np.testing.assert_allclose(log.time, np.arange(N))
    assert any("left out" in r and "rate" in r and "meta.who" in r for r in log.remarks)


@WRITERS
def test_a_file_cut_off_anywhere_is_refused(tmp_path: Path, writer):
    """No half of a recording is read for the whole."""
    whole = writer(tmp_path / "a.mat", variables(random_log(3, n=N), wide=False)).read_bytes()
    for size in np.linspace(10, len(whole) - 100, 8).astype(int):
        with pytest.raises(LogError):
            read_log(write(tmp_path / "cut.mat", whole[:size]))


@WRITERS
def test_a_file_without_samples_says_how_to_save_one(tmp_path: Path, writer):
    """Scalars and text are no recording."""
    with pytest.raises(LogError, match=r"no variable with samples.*Save one variable a signal"):
        read_log(writer(tmp_path / "a.mat", {"rate": 100.0, "who": "lab"}))


def test_a_missing_library_names_the_extra_that_brings_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Version 7.3 needs h5py; version 5 does not."""
    content = variables(random_log(6, n=N), wide=False)
    new, old = write_73(tmp_path / "new.mat", content), write_5(tmp_path / "old.mat", content)
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(MissingExtraError, match=r"h5py, which is not installed.*gpcorrect\[matlab\]"):
        matlab.read(new, ReadSettings())
    assert len(matlab.read(old, ReadSettings())) == N


def test_a_trajectory_of_another_length_is_refused(tmp_path: Path):
    """It was left out, and all motions were taken for one."""
    content = {"time": np.arange(9.0), "trajectory": np.arange(3), "tracker_cp": np.ones((9, 3))}
    savemat(tmp_path / "a.mat", content)
    with pytest.raises(LogError, match="column trajectory must hold a number for every sample"):
        read_log(tmp_path / "a.mat")
