"""Cases of the MuJoCo truth have the size that is asked for, repeat, and are files that the product reads."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

import mujoco_cases  # skips where MuJoCo is missing
import numpy as np
import pytest
from discrepancy_cases import Job
from discrepancy_jobs import jobs_of, write_files
from truth_mujoco.arms import ARMS
from truth_mujoco.body import robot_xml

from gpcorrect.logs import read_log
from gpcorrect.sim import read_model

SMALL = {"trajectories": 3, "seconds": 4.0}


@pytest.mark.parametrize(
    ("name", "signals", "ratio"),
    [
        ("backlash", "joints", 2.0),
        ("cable_stretch", "both", 0.5),
        ("dh_error", "tracker", 1.0),
        ("speed_noise", "joints", 1.0),
    ],
)
def test_a_hidden_cause_has_the_asked_size(name: str, signals: str, ratio: float) -> None:
    """The trace's RMS over the noise's RMS is the ratio, by the labels, which are measured on the whole run."""
    case = mujoco_cases.make_truth(mujoco_cases.Spec("one", "raven2_left", (name,), ratio, signals, **SMALL), 5).case
    (effect,) = case.labels["effects"]
    assert effect["name"] == name
    assert effect["ratio"] == pytest.approx(ratio, rel=1e-6)


def test_the_same_seed_gives_the_same_case() -> None:
    """Wish and seed fix the recording and the labels; another seed changes them."""
    spec = mujoco_cases.Spec("pairs", "dvrk_psm", ("backlash", "drift"), 1.0, "both", **SMALL)
    first, again, other = (mujoco_cases.make_truth(spec, seed).case for seed in (21, 21, 22))
    assert first.labels == again.labels != other.labels
    for name in ("external_jp", "measured_jp", "measured_jf"):
        np.testing.assert_array_equal(getattr(first.log, name), getattr(again.log, name))
        assert not np.array_equal(getattr(first.log, name), getattr(other.log, name))


@pytest.mark.parametrize(
    ("arm", "signals", "outside"),
    [
        ("raven2_left", "joints", {"external_jp"}),
        ("dvrk_psm", "tracker", {"tracker_cp"}),
        ("raven2_left", "both", {"external_jp", "tracker_cp"}),
        ("ur5", "bare", {"external_jp"}),
    ],
)
def test_files_are_the_products_own(arm: str, signals: str, outside: set[str], tmp_path: Path) -> None:
    """Recording and nominal model are read by the product; the outside signals are those that were asked for."""
    job = Job(mujoco_cases.Spec("null", arm, signals=signals, trajectories=2, seconds=4.0), 2, baselines=False)
    write_files(job, mujoco_cases.make_truth(job.spec, job.seed).case, tmp_path)
    model, log = read_model(tmp_path / "nominal.toml"), read_log(tmp_path / "log.csv")
    assert len(model.joints) == ARMS[arm].dof
    assert set(log.signals) & {"external_jp", "tracker_cp"} == outside


@pytest.mark.parametrize("arm", sorted(ARMS))
def test_the_robot_file_is_the_nominal_arm(arm: str) -> None:
    """MuJoCo reads it back with the same weight at the joints, and every joint may go where it does."""
    import mujoco
    from truth_mujoco.body import nominal_model

    known = ARMS[arm]
    models = mujoco.MjModel.from_xml_string(robot_xml(known, known.gravity)), nominal_model(known, known.gravity)
    torques = []
    for model in models:
        data = mujoco.MjData(model)
        data.qpos[:] = known.ranges[:, 1]
        mujoco.mj_forward(model, data)
        torques.append(np.array(data.qfrc_bias))
    np.testing.assert_allclose(*torques, atol=1e-4)
    low, high = models[0].jnt_range.T
    assert (low < known.ranges[:, 0]).all()
    assert (high > known.ranges[:, 1]).all()


def test_the_bench_asks_for_both_truths() -> None:
    """`--truth both` yields cases of each with its own seeds; finished ones are told apart by their keys."""
    asked = Namespace(
        truth="both",
        suite=["null", "pairs"],
        short=True,
        share=None,
        first_seed=None,
        baselines_every=0,
        least_ratio=0.0,
    )
    jobs = list(jobs_of(asked))
    assert {job.truth for job in jobs} == {"numpy", "mujoco"}
    assert {job.seed // 10_000 for job in jobs if job.truth == "mujoco"} == {50}
    assert len({job.key for job in jobs}) == len(jobs)
    with pytest.raises(SystemExit, match="zigzag"):
        list(jobs_of(Namespace(**{**vars(asked), "truth": "mujoco", "suite": ["zigzag"]})))
    large = Namespace(**{**vars(asked), "truth": "mujoco", "suite": ["one"], "share": 1.0, "least_ratio": 1.0})
    sizes = [job.spec.ratio for job in jobs_of(large)]
    assert len(sizes) == 120
    assert set(sizes) == {1.0, 2.0}
