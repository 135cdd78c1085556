"""What `import gpcorrect` offers is enough for the whole job."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from support import small_log

import gpcorrect
import gpcorrect.discrepancy
import gpcorrect_service


@pytest.mark.parametrize("door", [gpcorrect, gpcorrect.discrepancy, gpcorrect_service], ids=lambda door: door.__name__)
def test_every_public_name_is_there(door: ModuleType) -> None:
    """`__all__` names what exists, once, in order."""
    assert list(door.__all__) == sorted(set(door.__all__))
    assert all(hasattr(door, name) for name in door.__all__)
    assert not hasattr(door, "nonsense")


def test_write_read_fit_save_load_and_correct(tmp_path: Path) -> None:
    """A lab's whole morning in five calls: the loaded model answers as the fitted one."""
    gpcorrect.write_log(small_log(trajectories=6, samples=40), tmp_path / "reaches.csv")
    fitted = gpcorrect.fit_corrector(gpcorrect.read_log(tmp_path / "reaches.csv"))
    gpcorrect.save(fitted, tmp_path / "model.gpc")
    pose = [0.1, 0.0, -0.1, 1.0, 0.0, 0.0, 0.0]
    answer, again = fitted.correct(pose), gpcorrect.load(tmp_path / "model.gpc").correct(pose)
    np.testing.assert_array_equal(answer.position, again.position)
    assert np.linalg.norm(answer.position - pose[:3]) > 1e-3
