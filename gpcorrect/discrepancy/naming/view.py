"""A search as it is seen on both parts: the discovery that it was made on, and the confirmation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gpcorrect.discrepancy.evidence.whitener import DatasetWhitener, whitener_on
from gpcorrect.discrepancy.search.candidates import FittedEffect
from gpcorrect.discrepancy.search.instants import with_open_instant_placed
from gpcorrect.discrepancy.search.prepared import PreparedData
from gpcorrect.discrepancy.search.state import Search
from gpcorrect.types import FloatArray


@dataclass(frozen=True, eq=False)
class View:
    """A search with the recording that it was made on, and the whitener of its confirmation part."""

    search: Search
    prepared: PreparedData
    confirmation: DatasetWhitener

    def whitened_residuals(self, fitted: Sequence[FittedEffect]) -> tuple[FloatArray, FloatArray]:
        """Return the whitened residual of a set on discovery and confirmation.

        Parameters
        ----------
        fitted : sequence of FittedEffect, the set
        """
        placed = [self.placed(fitted, fit)[0] for fit in fitted]
        discovery, confirmation = self.whitened(self.search.residual(placed)[:, :, None])
        return discovery[:, 0], confirmation[:, 0]

    def placed(self, fitted: Sequence[FittedEffect], fit: FittedEffect) -> tuple[FittedEffect, float]:
        """Return an effect with the instant that confirmation shows where discovery leaves it open, and its price.

        Parameters
        ----------
        fitted : sequence of FittedEffect, the set
        fit : FittedEffect, one of them

        Returns
        -------
        fit : FittedEffect
        nats : float, that the choice among so many instants costs the confirmation part
        """
        if fit.candidate.instant is None:
            return fit, 0.0
        others = [m for m in fitted if m is not fit]
        found, instants = with_open_instant_placed(self.confirmation, others, fit, self.search.dataset.discovery)
        return found, float(np.log(instants))

    def whitened(self, columns: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return columns whitened on discovery and confirmation.

        Parameters
        ----------
        columns : (m, c, k) array, of every channel
        """
        return self.search.whitener.whiten_columns(columns), self.confirmation.whiten_columns(columns)


def view_of(search: Search, prepared: PreparedData) -> View:
    """Whiten the confirmation part with the noise of discovery.

    Parameters
    ----------
    search : Search
    prepared : PreparedData
    """
    residual = search.residual(search.fitted)
    confirmation = whitener_on(search.dataset, residual, search.dataset.confirmation, search.whitener.noises)
    return View(search, prepared, confirmation)
