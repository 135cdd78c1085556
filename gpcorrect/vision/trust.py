"""Which views of a ball are trusted: those that agree on one place in space (Peng et al. 2020, Sec. III-B)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from gpcorrect.errors import DegenerateError
from gpcorrect.types import FloatArray
from gpcorrect.vision.camera import Camera
from gpcorrect.vision.rim import Outline
from gpcorrect.vision.search import Reason
from gpcorrect.vision.settings import ViewSettings
from gpcorrect.vision.space import Located, triangulate


@dataclass
class View:
    """One ball in one camera."""

    effective: bool = False  # whether it is trusted; otherwise it is suspended
    reason: Reason = Reason.NOT_FOUND  # why it is suspended
    outline: Outline | None = None  # what was found in this frame
    good: int = 0  # frames in which a suspended view agreed with the others
    delay: float = 0.0  # by how much later than the frame's time it was taken, s
    # (2,) by how much its ray moved since the frame's time, as far as the motion is known
    shift: FloatArray = field(default_factory=lambda: np.zeros(2))
    slack_px: float = 0.0  # how uncertain `shift` is

    def suspend(self, reason: Reason) -> None:
        """Trust this view no more, until it has been good for long enough.

        Parameters
        ----------
        reason : Reason
        """
        self.effective, self.reason, self.good = False, reason, 0

    def admit(self) -> None:
        """Trust this view."""
        self.effective, self.reason = True, Reason.NONE


def agree(
    views: Sequence[View], cameras: Sequence[Camera], settings: ViewSettings, *, settled: bool
) -> tuple[Located | None, list[float]]:
    """Locate a ball from its trusted views; suspend those against the others, and count good frames.

    Parameters
    ----------
    views : sequence of View, of one ball, one a camera; changed in place
    cameras : sequence of Camera
    settings : ViewSettings
    settled : bool, where fewer than two views are trusted, take all that see the ball

    Returns
    -------
    Located or None
        Where the ball is, at the frame's time.
    list of float
        Its radius as each trusted view has it, m.
    """
    seen = [k for k, view in enumerate(views) if view.outline is not None]
    trusted = [k for k in seen if views[k].effective]
    trusted = _consensus(seen if len(trusted) < 2 and settled else trusted, views, cameras, settings)
    point, sizes = _located(trusted, views, cameras), []
    for k in seen if point is not None else ():
        view, outline = views[k], views[k].outline
        assert outline is not None
        assert point is not None
        local = cameras[k].local(point.position)[0]
        off = cameras[k].intrinsics.focal * float(np.linalg.norm(outline.ray - view.shift - local[:2] / local[2]))
        if k in trusted:
            view.admit()
            sizes.append(float(np.linalg.norm(local) * np.sin(outline.half_angle)))
        elif not off <= limit_px(view, settings):
            view.suspend(Reason.AGAINST_OTHERS)
        else:
            view.good, view.reason = view.good + 1, Reason.COMING_BACK
            if view.good >= settings.good_frames:
                view.admit()
    return point, sizes


def limit_px(view: View, settings: ViewSettings) -> float:
    """Return how far (px) a view may be from where the others put the ball.

    Parameters
    ----------
    view : View
    settings : ViewSettings
    """
    return settings.reprojection_px + min(2.0 * view.slack_px, settings.motion_px)


def _consensus(seen: list[int], views: Sequence[View], cameras: Sequence[Camera], settings: ViewSettings) -> list[int]:
    """Leave out the worst view until the others agree; of two that disagree neither is trusted."""
    while len(seen) >= 2:
        point = _located(seen, views, cameras)
        if point is None:
            return []
        off = np.linalg.norm(point.residuals, axis=1)
        over = off / np.array([limit_px(views[k], settings) for k in seen])
        if float(over.max()) <= 1.0:
            return seen
        if len(seen) == 2:
            for k in seen:
                views[k].suspend(Reason.AGAINST_OTHERS)
            return []
        rests = [seen[:i] + seen[i + 1 :] for i in range(len(seen))]  # without the worst the others agree best
        points = [_located(rest, views, cameras) for rest in rests]
        left = [np.inf if p is None else np.linalg.norm(p.residuals, axis=1).max() for p in points]
        seen = rests[int(np.argmin(left)) if np.isfinite(left).any() else int(np.argmax(over))]
    return []


def _located(seen: Sequence[int], views: Sequence[View], cameras: Sequence[Camera]) -> Located | None:
    """Return where some views put the ball; None where they cannot."""
    found = [(cameras[k], views[k].shift, o) for k in seen if (o := views[k].outline) is not None]
    if len(found) < 2:
        return None
    rays, covariances = np.array([o.ray - shift for _, shift, o in found]), np.array([o.covariance for *_, o in found])
    try:
        return triangulate([camera for camera, *_ in found], rays, covariances)
    except DegenerateError:
        return None
