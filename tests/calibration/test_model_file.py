"""A model file gives back the model, and is refused when it is not what was written."""

from __future__ import annotations

import io
import json
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support import small_log

from gpcorrect.calibration import CommandCorrector, load, load_with_hash, model_file, model_hash, save
from gpcorrect.calibration.model_file import OLDEST, SCHEMA, seal_of
from gpcorrect.codec import pack
from gpcorrect.errors import ArtifactError

ALPHA = "model.law.learned.predictor.parts.0.alpha"


@pytest.fixture
def model(small_corrector: CommandCorrector, tmp_path: Path) -> Path:
    save(small_corrector, tmp_path / "m.gpc")
    return tmp_path / "m.gpc"


def rewritten(path: Path, **entries: np.ndarray) -> Path:
    """Return a copy of the model file with some entries replaced, its zip directory and CRCs in order."""
    with np.load(path) as archive:
        contents = {name: archive[name] for name in archive.files}
    np.savez(path.with_suffix(".npz"), **{**contents, **entries})
    return path.with_suffix(".npz")


def header_of(path: Path) -> dict[str, object]:
    with np.load(path) as archive:
        header: dict[str, object] = json.loads(archive["header"].tobytes())
        return header


def as_entry(header: dict[str, object]) -> np.ndarray:
    return np.frombuffer(json.dumps(header).encode(), dtype=np.uint8)


def test_a_loaded_model_answers_as_the_saved_one(small_corrector: CommandCorrector, model: Path) -> None:
    """Every number of every answer is the same to the last bit, and so is the judgement of a log's samples."""
    loaded = load(model)
    for query in small_corrector.check_queries:
        before, after = (c.correct(query[:7], query[7:]) for c in (small_corrector, loaded))
        for name in ("position", "quaternion", "std", "interval95"):
            np.testing.assert_array_equal(getattr(before, name), getattr(after, name))
    log = small_log(seed=9)
    np.testing.assert_array_equal(loaded.clean(log).reason, small_corrector.clean(log).reason)
    assert loaded.info() == json.loads(json.dumps(small_corrector.info()))


def test_the_hash_is_that_of_the_model_that_was_read(
    small_corrector: CommandCorrector, model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file that is replaced while it is read gives the old model under the old hash, never one under the other's."""
    expected, unpacked = model_hash(model), model_file.unpack
    other = tmp_path / "other.gpc"
    save(replace(small_corrector, history=()), other)

    def _replaced(*given: object) -> object:
        if other.exists():  # once: parts of what is read are unpacked too
            other.replace(model)
        return unpacked(*given)

    with monkeypatch.context() as patched:
        patched.setattr(model_file, "unpack", _replaced)
        read, digest = load_with_hash(model)
    assert (digest, read.history) == (expected, small_corrector.history)
    assert (model_hash(model) != expected, load(model).history) == (True, ())


@pytest.mark.parametrize("share", [0.0, 0.01, 0.3, 0.7, 0.999])
def test_a_truncated_file_is_refused(model: Path, share: float) -> None:
    """Wherever a copy was cut off, it is not taken for a model."""
    whole = model.read_bytes()
    model.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(ArtifactError):
        load(model)


def test_flipped_bits_are_refused(model: Path) -> None:
    """A bit flipped in an array's bytes anywhere in the file is noticed, or changes nothing that is read."""
    whole, expected = model.read_bytes(), pack(load(model), "model")[1]
    rng = np.random.default_rng(3)
    refused = 0
    for place in rng.integers(0, len(whole), 60):
        damaged = bytearray(whole)
        damaged[place] ^= 1 << int(rng.integers(8))
        model.write_bytes(bytes(damaged))
        try:
            arrays = pack(load(model), "model")[1]
        except ArtifactError:
            refused += 1
            continue
        for name, array in expected.items():
            np.testing.assert_array_equal(arrays[name], array)
    assert refused > 50


def test_an_array_altered_with_its_crc_mended_is_refused(model: Path) -> None:
    """The digests in the header catch what the archive's own sums do not."""
    with np.load(model) as archive:
        alpha = archive[ALPHA].copy()
    alpha.flat[0] += 1e-3
    with pytest.raises(ArtifactError, match="was altered"):
        load(rewritten(model, **{ALPHA: alpha}))


def test_answers_other_than_the_recorded_ones_are_refused(model: Path) -> None:
    """A header whose seal was made again is still refused where the model answers otherwise than recorded."""
    header = header_of(model)
    header["model"]["velocity_steps"] = [0.5, 0.5]  # type: ignore[index]
    header["check"][0][0] += 0.01  # type: ignore[index]
    header["seal"] = seal_of(header)
    with pytest.raises(ArtifactError, match="check queries"):
        load(rewritten(model, header=as_entry(header)))


def test_a_file_of_one_stencil_has_it_for_positions_and_turns(model: Path) -> None:
    """Before schema 7 one step stood for both velocities."""
    header = header_of(model)
    tree: dict[str, object] = header["model"]  # type: ignore[assignment]
    del tree["velocity_steps"]
    header |= {"schema": 6, "model": {**tree, "velocity_step": 0.04}}
    header["seal"] = seal_of(header)
    assert load(rewritten(model, header=as_entry(header))).velocity_steps == (0.04, 0.04)


@pytest.mark.parametrize("name", ["model", "version", "schema"])
def test_an_edited_header_is_refused(model: Path, name: str) -> None:
    """What no check query asks about cannot be edited either: the header carries its own sum."""
    header = header_of(model)
    header[name] = {"schema": SCHEMA, "version": "0", "model": {**header["model"], "x": 1}}[name]  # type: ignore[dict-item]
    header["edited"] = True
    with pytest.raises(ArtifactError, match="header was altered"):
        load(rewritten(model, header=as_entry(header)))


def test_a_newer_schema_is_refused_with_the_version_that_wrote_it(model: Path) -> None:
    """The message says which schema came and what to do."""
    header = {**header_of(model), "schema": SCHEMA + 1, "version": "99.0"}
    with pytest.raises(ArtifactError, match=rf"schema {SCHEMA + 1}.*99\.0"):
        load(rewritten(model, header=as_entry(header)))


def test_a_file_of_an_older_schema_is_refused_with_what_to_do(model: Path) -> None:
    """Models without regions and bounds for every task are not read: they are fitted again."""
    header = {**header_of(model), "schema": OLDEST - 1}
    with pytest.raises(ArtifactError, match="Fit the model again"):
        load(rewritten(model, header=as_entry(header)))


def test_a_file_that_unpacks_to_more_than_it_is_long_is_refused(model: Path, tmp_path: Path) -> None:
    """Sixty megabytes of zeros, compressed into a few kilobytes, are never unpacked."""
    with np.load(model) as archive:
        contents = {name: archive[name] for name in archive.files}
    np.savez_compressed(tmp_path / "bomb.npz", **contents, zeros=np.zeros(8_000_000))
    with pytest.raises(ArtifactError, match="more than it is long"):
        load(tmp_path / "bomb.npz")


def test_a_pickle_inside_is_refused_and_not_run(model: Path, tmp_path: Path) -> None:
    """An object array, which NumPy would unpickle, never is."""
    ran = tmp_path / "ran"

    class Bomb:
        def __reduce__(self) -> tuple[object, tuple[Path]]:
            return Path.touch, (ran,)

    buffer = io.BytesIO()
    np.save(buffer, np.array([Bomb()], dtype=object), allow_pickle=True)
    with zipfile.ZipFile(model, "a") as archive:
        archive.writestr("bomb.npy", buffer.getvalue())
    with pytest.raises(ArtifactError):
        load(model)
    assert not ran.exists()


def test_files_that_are_no_models_are_refused(tmp_path: Path) -> None:
    """Text, an empty archive, a bare array and a missing file are each refused."""
    (tmp_path / "text").write_text("not a model")
    np.save(tmp_path / "array.npy", np.zeros(3))
    np.savez(tmp_path / "empty.npz")
    for name in ("text", "array.npy", "empty.npz", "missing"):
        with pytest.raises(ArtifactError):
            load(tmp_path / name)
