"""Forged and damaged files: refused in words, in bounded memory, and nothing else is touched."""

from __future__ import annotations

import json
import zipfile
import zlib
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from joint_logs import joint_log
from support import sealed_file, short_search, small_log

from gpcorrect.calibration import CommandCorrector, FitSettings, JointCorrector, ModelStore, fit_model, save
from gpcorrect.calibration.coupled_play import CoupledPlay
from gpcorrect.calibration.domain import Domain
from gpcorrect.calibration.joint_features import JointFeatures
from gpcorrect.calibration.learners.polynomial import PolynomialMap
from gpcorrect.calibration.learners.ukf import CableModel
from gpcorrect.calibration.model_file import load_any, read_parts
from gpcorrect.errors import ArtifactError, DataError, GpCorrectError, LogError
from gpcorrect.gpr.features import FeatureMap
from gpcorrect.gpr.intervals import IntervalCalibration
from gpcorrect.logs import read_log, write_log

VALUES: tuple[Any, ...] = (
    None,
    "x",
    "array:model",
    -1,
    0,
    1e300,
    10**30,
    [],
    [[]],
    {},
    {"type": "Law"},
    True,
    [1, "y"],
)


@pytest.fixture(scope="module", params=["pose", "joints"])
def model(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a model file of either task."""
    path = tmp_path_factory.mktemp("models") / f"{request.param}.gpc"
    if request.param == "joints":
        settings = FitSettings(method="linear", features=("position",))
        save(fit_model(joint_log(1, trajectories=4), settings, task=JointCorrector).corrector, path)
    else:
        with short_search(40):
            save(fit_model(small_log(trajectories=4), FitSettings(inducing=12, clean=False)).corrector, path)
    return path


@pytest.mark.parametrize(
    ("place", "forged"),
    [
        ("fit", "x"),
        ("fit.dropped", {"occluded": "many"}),
        ("data", []),
        ("data.sha256", 3),
        ("features", "pose"),
        ("features", [3]),
        ("remarks", [{"a": 1}]),
        ("baseline", [None]),
        ("training_region", {"position_min": [0, 0, 0]}),
        ("training_region", {"position_min": [0, 0], "position_max": [1, 1, 1]}),
        ("frames", ["tracker", "base"]),
        ("updates", [{}]),
        ("updates", 1),
        ("arm", {}),
    ],
)
def test_a_description_that_programs_cannot_read_is_refused(
    model: Path, tmp_path: Path, place: str, forged: Any
) -> None:
    """What `info`, `models diff`, `drift` and the service read of it is of the type that they expect, or no model."""
    header, arrays = read_parts(model)
    node, *inner = (header["model"]["summary"], *place.split("."))
    for name in inner[:-1]:
        node = node[name]
    node[inner[-1]] = forged
    with pytest.raises(ArtifactError, match="do not form a model"):
        load_any(sealed_file(tmp_path / "forged.gpc", header, arrays))


@pytest.mark.parametrize("name", ["kind", "schema", "version", "model", "digests"])
def test_no_entry_of_a_header_is_believed_to_be_what_it_should(model: Path, tmp_path: Path, name: str) -> None:
    """A number, list or table where a word belongs, under a fresh seal, is refused in words (a table was not)."""
    for value in VALUES:
        header, arrays = read_parts(model)
        if type(value) is type(header[name]):
            continue
        header[name] = value
        with suppress(ArtifactError):
            load_any(sealed_file(tmp_path / "forged.gpc", header, arrays))


@pytest.mark.parametrize("name", ["header.npy", "more.npy"])
def test_a_part_that_is_no_array_is_refused(tmp_path: Path, name: str) -> None:
    """What does not begin as an array NumPy hands out as bytes; a file of them ended its loading in a traceback."""
    with zipfile.ZipFile(tmp_path / "forged.gpc", "w") as out:
        out.writestr(name, b"no array")
    with pytest.raises(ArtifactError, match="truncated or altered"):
        load_any(tmp_path / "forged.gpc")


@pytest.mark.parametrize(
    "forged",
    [
        {"models": [{"id": "m", "hash": "../../secret", "kind": "pose", "added": 0}], "history": {}},
        {"models": [{"id": 3, "hash": "0" * 64, "kind": "pose", "added": 0}], "history": {}},
        {"models": [{"id": "m", "hash": "0" * 64, "kind": ["pose"], "added": 0}], "history": {}},
        {"models": [], "history": {"pose": ["0" * 64]}},
        {"models": [], "history": {"pose": [[]]}},
        {"models": [], "history": {"pose": 3}},
        {"models": {"a": 1}, "history": []},
    ],
)
def test_a_forged_store_is_refused(forged: dict[str, Any], tmp_path: Path) -> None:
    """What a store says is believed only where a store could have written it: no path leads out of the folder."""
    (tmp_path / "store.json").write_text(json.dumps({"schema": 1, **forged}))
    with pytest.raises(DataError, match="not the state of a model store"):
        ModelStore(tmp_path).history()
    (tmp_path / "store.json").write_text("[" * 100_000)
    with pytest.raises(DataError, match="cannot be read"):
        ModelStore(tmp_path).models()


def test_the_lock_is_no_way_to_another_file(model: Path, tmp_path: Path) -> None:
    """A lock file that links elsewhere is not followed: the other file keeps what it holds."""
    other = tmp_path / "precious.txt"
    other.write_text("kept")
    store = ModelStore(tmp_path / "store")
    (tmp_path / "store").mkdir()
    (tmp_path / "store" / ".lock").symlink_to(other)
    with pytest.raises(GpCorrectError, match="cannot write"):
        store.add(model, now=0.0)
    assert other.read_text() == "kept"


def test_tables_that_unpack_to_more_than_memory_are_refused(tmp_path: Path) -> None:
    """A Parquet file of constants and a MATLAB file of zeros say by their size nothing of what they unpack to."""
    pa = pytest.importorskip("pyarrow", reason="Parquet files need pyarrow: pip install 'gpcorrect[all]'")
    parquet = pytest.importorskip("pyarrow.parquet", reason="Parquet files need pyarrow: pip install 'gpcorrect[all]'")
    n = 2_000_000
    parquet.write_table(pa.table({"time": np.arange(n) // n, "x": np.zeros(n)}), tmp_path / "a.parquet")
    body = zlib.compress(bytes(8 * n))
    head = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"
    tag = (15).to_bytes(4, "little") + len(body).to_bytes(4, "little")
    (tmp_path / "a.mat").write_bytes(head + tag + body)
    for file in (tmp_path / "a.parquet", tmp_path / "a.mat"):
        assert file.stat().st_size < 1e6
        with pytest.raises(LogError, match="unpacks to more"):
            read_log(file, max_bytes=10_000_000)


def test_impossible_numbers_count_as_missing_and_are_said(tmp_path: Path) -> None:
    """Infinity and 1e304 m are no measurements: a reader leaves them out with a remark."""
    log = small_log(trajectories=1)
    position = np.array(log.tracker_cp.position)
    position[[3, 5]] = [[np.inf, 0, 0], [0, 1e304, 0]]
    write_log(replace(log, tracker_cp=replace(log.tracker_cp, position=position)), tmp_path / "log.csv")
    read = read_log(tmp_path / "log.csv")
    assert not read.tracker_cp.finite[[3, 5]].any()
    assert read.tracker_cp.finite.sum() == len(log) - 2
    assert any("2 samples of tracker_cp" in remark for remark in read.remarks)


def test_numbers_that_no_check_query_asks_for_must_fit_as_well(tmp_path: Path) -> None:
    """The fixed offset is for comparison only: of another length, its model was loaded and failed when measured."""
    settings = FitSettings(method="linear", features=("position",))
    model: JointCorrector = fit_model(joint_log(1, trajectories=4), settings, task=JointCorrector).corrector
    for moving in ([0, 1, np.iinfo(np.int64).min], [0, 0, 0], [2, 1, 0]):
        with pytest.raises(DataError, match="not 3 in order"):
            replace(model.view, moving=np.array(moving))
    for rest in (np.zeros(2), model.view.rest[:, None]):
        with pytest.raises(DataError, match="rests in"):
            replace(model.view, rest=rest)
    moved = model.trained
    with pytest.raises(DataError, match="do not fit"):
        replace(moved, low=moved.low[:2])
    with pytest.raises(DataError, match="does not fit together"):
        replace(model, trained=replace(moved, low=moved.low[:2], high=moved.high[:2], size=moved.size[:2]))
    for offset in (np.zeros(7), model.offset[:, None]):
        with pytest.raises(DataError, match="does not fit together"):
            replace(model, offset=offset)


def test_parts_of_other_sizes_never_reach_compiled_code(small_corrector: CommandCorrector) -> None:
    """Compiled code writes as much as it was built for: features without a spread had it write beyond its arrays."""
    whole, law = small_corrector, small_corrector.law
    assert law.bounds.sizes == (3, 3)
    for parts in (
        {"features": replace(whole.features, spread=np.empty(0))},
        {"features": replace(whole.features, kinds=("pose",), spread=whole.features.spread[:6])},
        {"law": replace(law, domain=Domain(-np.ones(2), np.ones(2), 1.0, np.ones(6)))},
        {"law": replace(law, bounds=replace(law.bounds, sizes=(6,), largest=np.ones(1)))},
        {"check_queries": whole.check_queries[:, :9]},
        {"trained": replace(whole.trained, low=np.zeros(2), high=np.ones(2), size=np.ones(2))},
    ):
        with pytest.raises(DataError, match=r"does not fit together|was asked about"):
            replace(whole, **parts)
    with pytest.raises(DataError, match="stiffness"):
        CoupledPlay(np.eye(3), np.ones(2))
    motor = PolynomialMap.fit(np.eye(2), np.eye(2), 1)
    for numbers in ([[0.0, 0.0]] * 3 + [[0.1]], [[-0.1, 0.0]] * 4, [[np.nan, 0.0]] * 4):
        with pytest.raises(DataError, match="cable"):
            CableModel(motor, motor, *map(np.array, numbers))


@pytest.mark.parametrize(
    ("part", "forged"),
    [
        (IntervalCalibration(np.ones(2)), {"factor": np.array([1.0, np.nan])}),
        (IntervalCalibration(np.ones(2)), {"factor": np.array([1.0, -1e300])}),
        (IntervalCalibration(np.ones(2)), {"factor": np.ones((1, 2))}),
        (PolynomialMap.fit(np.eye(2), np.eye(2), 1), {"weights": np.ones((1, 3, 2))}),
        (
            JointFeatures(("position",), np.ones(2), np.ones(2), None, np.ones(1), 0, np.arange(2)),
            {"kinds": 2 * ("lags",)},
        ),
        (Domain(-np.ones(2), np.ones(2), 1.0, np.ones(3)), {"low": np.array([0.0, np.nan])}),
        (Domain(-np.ones(2), np.ones(2), 1.0, np.ones(3)), {"high": np.array([1.0, -2.0])}),
        (Domain(-np.ones(2), np.ones(2), 1.0, np.ones(3)), {"spread": np.array([1.0, 1.0, -1.0])}),
        (Domain(-np.ones(2), np.ones(2), 1.0, np.ones(3)), {"fading": np.array([2])}),
        (FeatureMap(("pose",), spread=np.ones(3)), {"spread": np.array([1.0, 1.0, 0.0])}),
        (FeatureMap(("pose",), spread=np.ones(3)), {"R_mean": -np.eye(3)}),
    ],
)
def test_numbers_that_cannot_be_make_no_part_of_a_model(part: Any, forged: dict[str, Any]) -> None:
    """Widths that are negative, regions that end before they begin, and features without a spread are refused."""
    with pytest.raises(DataError, match=r"cannot be|no region|to fade|no features|do not fit"):
        replace(part, **forged)
