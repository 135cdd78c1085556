"""Laws of whitened columns: of one channel they are what they are among all."""

from __future__ import annotations

import numpy as np
import pytest
from discrepancy_core import joint_log
from discrepancy_support import nominal

from gpcorrect.discrepancy.evidence.whitener import whitener_on
from gpcorrect.discrepancy.search.prepared import prepare_data


@pytest.mark.parametrize("part", ["discovery", "confirmation"])
def test_columns_of_one_channel_are_those_among_all(part: str) -> None:
    """To the bit, on either part, whatever stands in the other channels' rows."""
    dataset = prepare_data(joint_log(3), nominal(), np.random.default_rng(0)).dataset
    whitener = whitener_on(dataset, dataset.residual(), getattr(dataset, part))
    values = np.random.default_rng(1).standard_normal((len(dataset.time), 5))
    for channel in range(len(dataset.scene.channels)):
        among = np.zeros((len(values), len(dataset.scene.channels), 5))
        among[:, channel] = values
        np.testing.assert_array_equal(
            whitener.whiten_columns(values[:, None], np.arange(len(among[0])) == channel),
            whitener.whiten_columns(among)[whitener.channel == channel],
        )
