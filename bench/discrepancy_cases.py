"""One blind case: made by the truth's simulator, solved by the workflow and the baselines, and scored."""

from __future__ import annotations

import warnings
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from discrepancy_baselines import BASELINES, library_of
from threadpoolctl import threadpool_limits
from truth import Spec, further_recording, joined, make_case, make_truth
from truth.spec import Case

from gpcorrect.discrepancy import DiscrepancyResult, Level, find_discrepancy
from gpcorrect.discrepancy.protocol.outcomes import CaseOutcome, case_outcome
from gpcorrect.errors import GpCorrectError
from gpcorrect.sim import EFFECTS, Model, model_from_dict
from gpcorrect.types import CalibrationLog

if TYPE_CHECKING:
    from truth_mujoco import Spec as MujocoSpec

ADVISED = "advised"
AHEAD = "ahead"  # causes that the catalogue is to learn
GROUPS = {"null_awkward": "awkward_null", "one": "single", "pairs": "pair", "triples": "triple"}


@dataclass(frozen=True)
class Job:
    """One case to make and solve."""

    spec: Spec | MujocoSpec
    seed: int
    baselines: bool

    @property
    def key(self) -> str:
        """Name of the case."""
        name = f"{self.spec.suite}_{self.seed}_{self.spec.trajectories}x{self.spec.seconds:g}"
        return name if self.truth == "numpy" else f"{self.truth}_{name}"

    @property
    def truth(self) -> str:
        """Which simulator makes it: "numpy" or "mujoco"."""
        return "numpy" if isinstance(self.spec, Spec) else "mujoco"


def case_of(job: Job) -> Case:
    """Make the recording of a case by the simulator that its spec is for."""
    if isinstance(job.spec, Spec):
        return make_case(job.spec, job.seed)
    from truth_mujoco import make_case as make_mujoco_case  # only where MuJoCo is asked for

    return make_mujoco_case(job.spec, job.seed)


def label_of(labels: dict[str, Any]) -> dict[str, Any]:
    """Labels of the truth packages as the scorer wants them: what the product's catalogue lacks is unknown to it."""
    effects = [
        {"name": e["name"], "joint": e["joint"], "known": e["name"] in EFFECTS} | e["params"] for e in labels["effects"]
    ]
    ratios = [e["ratio"] for e in labels["effects"]]
    suite = labels["suite"]
    if suite == AHEAD:
        suite = "one" if all(e["known"] for e in effects) else "outside"
    return {
        "set": GROUPS.get(suite, suite),
        "effects": effects,
        "effect_to_noise": min(ratios, default=None),
    }


def solve(job: Job, case: Case | None = None) -> dict[str, Any]:
    """Make a case, unless it is at hand, let the workflow and the baselines loose on it, and score them."""
    with threadpool_limits(1), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        case = case or case_of(job)
        label, model = label_of(dict(case.labels)), model_from_dict(case.nominal)
        try:
            found = find_discrepancy(model, case.log, seed=job.seed)
            if job.spec.suite == ADVISED:
                return _advised(job, found, label, model)
            report = found.to_report()
        except GpCorrectError as error:
            return _entry(job) | {"refused": str(error), "outcome": _refused(job, label)}
        outcome = asdict(case_outcome(job.key, label, report))
        others = _baselines(case.log, model, job.seed, label) if job.baselines else {}
        said = _said(report["verdict"])
        return _entry(job) | {"outcome": outcome, "said": said, "baselines": others}


def _entry(job: Job) -> dict[str, Any]:
    return {"key": job.key, "truth": job.truth, "suite": job.spec.suite}


def _advised(job: Job, found: DiscrepancyResult, label: dict[str, Any], model: Model) -> dict[str, Any]:
    """Make the advised run on the same hidden machine, give both recordings to the workflow, and score what it says.

    A case that is not ambiguous, or in which no run is advised, has no outcome and is not counted; a run with other
    gains is left out too, for one model file holds one controller.
    """
    entry = _entry(job) | {"outcome": None, "first": str(found.level)}
    advice = found.next_experiment
    if found.level not in (Level.CLASS, Level.SET) or advice is None:
        return entry
    entry["advice"] = found.to_report()["next_experiment"]
    if not found.advised_plans or any(gain != 1.0 for _, gain in found.advised_plans):
        return entry
    assert isinstance(job.spec, Spec), "advised runs are made by the NumPy truth only"
    truth = make_truth(job.spec, job.seed)
    rng = np.random.default_rng([job.seed, 77])
    logs = [truth.case.log, *(further_recording(truth, plan, rng) for plan, _ in found.advised_plans)]
    report = find_discrepancy(model, joined(logs), seed=job.seed).to_report()
    said = _said(report["verdict"])
    return entry | {"outcome": asdict(case_outcome(job.key, label, report)), "said": said}


def _refused(job: Job, label: dict[str, Any]) -> dict[str, Any]:
    """Return the score of a refusal, which is an answer too: it names nothing, and decides nothing."""
    report = {"verdict": {"level": "INCONCLUSIVE", "effects": []}, "gap": {}, "provenance": {"seconds": 0.0}}
    return asdict(case_outcome(job.key, label, report))


def _said(verdict: dict[str, Any]) -> dict[str, Any]:
    return {"level": verdict["level"]} | {k: [_brief(e) for e in verdict[k]] for k in ("effects", "alike")}


def _brief(effect: dict[str, Any]) -> str:
    numbers = f"{effect['probability']:.3f}, differs {effect['spread']:.2f}, closes {effect['closes']:.2f}"
    return f"{effect['level']} {effect['name']} {effect['joint']} {numbers}"


def _baselines(log: CalibrationLog, model: Model, seed: int, label: dict[str, Any]) -> dict[str, Any]:
    library = library_of(log, model, seed)
    true = {(e["name"], e["joint"]) for e in label["effects"] if e["known"]}
    found = {}
    for name, method in BASELINES.items():
        named = method(library)
        found[name] = {"exact": bool(true) and named == true, "wrong": bool(named - true), "silent": not named}
    return found


def outcome_of(values: dict[str, Any]) -> CaseOutcome:
    """Return the outcome that was written down as JSON."""
    lists = ("truth", "answers", "covered")
    pairs = tuple((float(p), bool(right)) for p, right in values["probabilities"])
    return CaseOutcome(**{**values, **{k: tuple(values[k]) for k in lists}, "probabilities": pairs})
