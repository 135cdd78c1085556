"""The regression on the real arm: held-out wrist positions of a dVRK."""

from __future__ import annotations

import numpy as np
from sklearn.linear_model import LinearRegression
from support import real_data

from gpcorrect import se3
from gpcorrect.gpr import FeatureMap, SparseGPR
from gpcorrect.logs import read_log
from gpcorrect.velocity import segment_labels, twists


def test_held_out_error_on_a_real_arm_is_far_below_a_straight_line_with_honest_intervals() -> None:
    """Last fifth: at most 0.9 of a linear model's RMSE and 0.75 of raw; 95 % intervals cover 85-99 %."""
    log = read_log(real_data("dvrk_random.csv"))
    assert log.tracker_cp.quaternion is not None
    position, rotation = log.tracker_cp.position, se3.matrix_from_quaternion(log.tracker_cp.quaternion)
    twist = twists(log.time, position, rotation, segment_labels(log.time, log.trajectory))
    train = log.trajectory < np.quantile(log.trajectory_ids, 0.8)
    features = FeatureMap(("pose", "velocity")).fit(position[train], rotation[train], twist[train])
    X, Y = features.transform(position, rotation, twist), log.setpoint_cp.position - position
    usable = np.isfinite(X).all(axis=1)
    train, test = train & usable, ~train & usable
    model = SparseGPR(n_inducing=500, feature_groups=features.groups)
    model.fit(X[train], Y[train], groups=log.session[train], times=log.time[train])
    mean, std = model.predict(X[test], return_std=True)
    line = LinearRegression().fit(X[train], Y[train]).predict(X[test])
    rmse = [np.sqrt(((Y[test] - p) ** 2).sum(axis=1).mean()) for p in (mean, line, np.zeros(3))]
    assert rmse[0] < 0.9 * rmse[1]
    assert rmse[0] < 0.75 * rmse[2]
    cover = (np.abs(Y[test] - mean) < 1.96 * std).mean(axis=0)
    assert (cover > 0.85).all()
    assert (cover < 0.99).all()
