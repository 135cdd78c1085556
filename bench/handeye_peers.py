"""Compare marker registration with two published closed forms on planted worlds: error and time.

Peers, written here from their papers and sharing no code with the package:

- Shah, "Solving the robot-world/hand-eye calibration problem using the Kronecker product", J. Mechanisms
  Robotics 5(3), 2013: both rotations from one SVD of `sum R_B (x) R_A`, translations from least squares.
- Li, Wang and Wu, "Simultaneous robot-world and hand-eye calibration using dual-quaternions and Kronecker
  product", Int. J. Physical Sciences 5(10), 2010: all 24 entries from one linear system, rotations projected;
  here translations are then solved again with the projected rotations, which is kinder to it than the paper.

Both solve `A Z = W B`: A the observed pose, B the commanded one, Z the tip in the marker, W the base in the
tracker.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from gpcorrect import se3
from gpcorrect.rigid import RigidModel, fit_marker
from gpcorrect.types import FloatArray, PoseSignal

RESULTS = Path(__file__).parent / "results" / "handeye_peers.json"
N_POSES = 300
Solver = Callable[[FloatArray, FloatArray], RigidModel]


@dataclass(frozen=True)
class Scenario:
    """How a world misses: white noise, a smooth error of pose, gross errors, and how far the tool turns."""

    name: str
    swing_deg: float = 35.0
    noise_mm: float = 0.5
    noise_deg: float = 0.5
    smooth_mm: float = 0.0
    smooth_deg: float = 0.0
    outliers: float = 0.0


SCENARIOS = (
    Scenario("noise only"),
    Scenario("small turns (6 deg)", swing_deg=6.0),
    Scenario("smooth error 5 mm, 10 deg", smooth_mm=5.0, smooth_deg=10.0),
    Scenario("10 % gross errors", outliers=0.1),
    Scenario("30 % gross errors", outliers=0.3),
    Scenario("smooth error and 10 % gross", smooth_mm=5.0, smooth_deg=10.0, outliers=0.1),
)


def ours(A: FloatArray, B: FloatArray) -> RigidModel:
    return fit_marker(PoseSignal(*se3.to_parts(A)), PoseSignal(*se3.to_parts(B)))


def shah(A: FloatArray, B: FloatArray) -> RigidModel:
    # vec(R_A R_Z R_B^T) = (R_B (x) R_A) vec(R_Z) = vec(R_W), vec by columns
    kronecker = sum(np.kron(b, a) for a, b in zip(A[:, :3, :3], B[:, :3, :3], strict=True))
    u, _, vt = np.linalg.svd(kronecker)
    R_Z, R_W = (_rotation_of(v.reshape(3, 3, order="F")) for v in (vt[0], u[:, 0]))
    return _with_translations(A, B, R_W, R_Z)


def li_wang_wu(A: FloatArray, B: FloatArray) -> RigidModel:
    # unknowns: rows of R_W, rows of R_Z, t_W, t_Z
    n, eye = len(A), np.eye(3)
    M, rhs = np.zeros((n, 12, 24)), np.zeros((n, 12))
    M[:, :9, :9] = -np.einsum("ij,nlk->nikjl", eye, B[:, :3, :3]).reshape(n, 9, 9)
    M[:, :9, 9:18] = np.einsum("nij,kl->nikjl", A[:, :3, :3], eye).reshape(n, 9, 9)
    M[:, 9:, :9] = np.einsum("ij,nl->nijl", eye, B[:, :3, 3]).reshape(n, 3, 9)
    M[:, 9:, 18:21], M[:, 9:, 21:] = eye, -A[:, :3, :3]
    rhs[:, 9:] = A[:, :3, 3]
    x = np.linalg.lstsq(M.reshape(-1, 24), rhs.ravel())[0]
    return _with_translations(A, B, _rotation_of(x[:9].reshape(3, 3)), _rotation_of(x[9:18].reshape(3, 3)))


def _rotation_of(matrix: FloatArray) -> FloatArray:
    u, _, vt = np.linalg.svd(matrix * np.sign(np.linalg.det(matrix)))
    rotation: FloatArray = u @ vt
    return rotation


def _with_translations(A: FloatArray, B: FloatArray, R_W: FloatArray, R_Z: FloatArray) -> RigidModel:
    # R_A t_Z - t_W = R_W t_B - t_A
    M = np.concatenate([A[:, :3, :3], np.broadcast_to(-np.eye(3), (len(A), 3, 3))], axis=2).reshape(-1, 6)
    x = np.linalg.lstsq(M, (B[:, :3, 3] @ R_W.T - A[:, :3, 3]).ravel())[0]
    return RigidModel("marker", R_W.T, -R_W.T @ x[3:], x[:3], R_W.T, R_Z)


def world(scenario: Scenario, rng: np.random.Generator) -> tuple[FloatArray, FloatArray, RigidModel]:
    """Observed poses A, commanded poses B, and the truth."""
    R, R_right = Rotation.random(2, random_state=rng).as_matrix()
    truth = RigidModel("marker", R, rng.normal(size=3), rng.normal(size=3) * 0.06, R, R_right)
    centre = rng.normal(size=3)
    position = centre + rng.uniform(-1, 1, size=(N_POSES, 3)) * [0.04, 0.04, 0.01]
    turn = Rotation.from_rotvec(rng.normal(size=(N_POSES, 3)) * np.radians(scenario.swing_deg))
    exact = PoseSignal(position, turn.as_quat(scalar_first=True))
    command = truth.apply(exact)
    B = se3.from_parts(command.position, command.quaternion)
    A = se3.from_parts(position, exact.quaternion)
    A[:, :3, 3] += rng.normal(size=(N_POSES, 3)) * scenario.noise_mm * 1e-3
    error = rng.normal(size=(N_POSES, 3)) * np.radians(scenario.noise_deg)
    A[:, :3, 3] += _smooth(position - centre, rng) * scenario.smooth_mm * 1e-3
    error += _smooth(position - centre, rng) * np.radians(scenario.smooth_deg)
    A[:, :3, :3] = se3.matrix_from_rotvec(error) @ A[:, :3, :3]
    rows = rng.permutation(N_POSES)[: int(scenario.outliers * N_POSES)]
    A[rows, :3, 3] += rng.normal(size=(len(rows), 3)) * 0.1
    A[rows, :3, :3] = Rotation.random(len(rows), random_state=rng).as_matrix()
    return A, B, truth


def _smooth(position: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Waves over the workspace of unit amplitude, lengths about 10 cm, with a mean of their own."""
    waves = rng.normal(size=(3, 3)) * 60.0
    field: FloatArray = np.sin(position @ waves + rng.uniform(0, 2 * np.pi, size=3))
    return field


def errors(model: RigidModel, truth: RigidModel) -> dict[str, float]:
    turn = max(float(se3.angle(getattr(model, k) @ getattr(truth, k).T)) for k in ("R_left", "R_right"))
    return {
        "offset_mm": 1e3 * float(np.linalg.norm(model.offset - truth.offset)),
        "turn_deg": float(np.degrees(turn)),
    }


def run(scenario: Scenario, solver: Solver, n_worlds: int) -> dict[str, float]:
    rows, seconds = [], []
    for seed in range(n_worlds):
        A, B, truth = world(scenario, np.random.default_rng(seed))
        start = time.perf_counter()
        model = solver(A, B)
        seconds.append(time.perf_counter() - start)
        rows.append(errors(model, truth))
    medians = {name: float(np.median([row[name] for row in rows])) for name in rows[0]}
    return {**medians, "milliseconds": 1e3 * float(np.median(seconds))}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worlds", type=int, default=20)
    parser.add_argument("--output", type=Path, default=RESULTS)
    args = parser.parse_args()
    solvers: dict[str, Solver] = {"gpcorrect": ours, "Shah 2013": shah, "Li-Wang-Wu 2010": li_wang_wu}
    table = []
    print(f"{N_POSES} poses, medians of {args.worlds} worlds: error of the lever arm and of the worse rotation")
    print(f"{'world':<30} {'method':<16} {'lever arm mm':>13} {'rotation deg':>13} {'time ms':>9}")
    for scenario in SCENARIOS:
        for name, solver in solvers.items():
            row = run(scenario, solver, args.worlds)
            table.append({"world": scenario.name, "method": name, **row})
            print(
                f"{scenario.name:<30} {name:<16} {row['offset_mm']:13.3f} {row['turn_deg']:13.3f} "
                f"{row['milliseconds']:9.1f}"
            )
    args.output.parent.mkdir(parents=True, exist_ok=True)
    args.output.write_text(json.dumps(table, indent=2))
    print(f"written to {args.output}")


if __name__ == "__main__":
    main()
