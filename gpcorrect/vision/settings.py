"""Every number of the cameras and the tracker that decides something, with where it comes from.

Where no source stands beside a number, it was chosen by hand on rendered recordings;
`python bench/vision_sensitivity.py` prints what half and twice of it do to accuracy, coverage and speed. Numbers that
change nothing there guard against what that recording lacks: markers that were mixed up, lenses that boards do not
determine, balls of the background's hue.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class BallSettings:
    """How a ball is found in one picture; fractions are of its radius, rim or disc."""

    # Outline: the point on each ray at which the colour changes fastest, then a cone through those points.
    rays: int = 64  # around the rim
    gamma: float = 2.2  # light is grey level to this power (IEC 61966-2-1, sRGB); 1 for cameras that give raw light
    step_px: float = 0.5  # between samples along a ray; bilinear pictures hold nothing finer
    reaches: tuple[float, ...] = (0.45, 0.25)  # how far in and out to sample: first pass, second pass
    least_outline_px: float = 2.0  # radius below which a rim has too few pixels
    contrast: float = 6.0  # standard deviations from ball to background, of what varies along the ball's part of a ray
    least_scatter: float = 0.01  # of full light, standard deviation: the noise, two grey levels, of a middle grey
    clipped: int = 250  # grey level from which a channel may be cut off at 255: 2.5 x the noise below it
    least_slope: float = 0.04  # of that contrast, per sample: below it there is no edge
    least_arc: float = 0.30  # of the rim must be visible: a third determines a cone, less is mostly its noise
    inlier_px: float = 0.35  # three times this from the cone, a rim point is another object's
    clean_px: float = 0.8  # no rim point farther off: nothing has to be left out
    converged_px: float = 0.6  # a start that was this good needs no second pass
    harmonics: int = 8  # of the rim's errors, from the second on, that show how large the first is
    # Standard deviation that systematic errors leave of any centre whose rim is blurred by 1 px; as shading and a gamma
    # that is not quite right have it, it grows with the square of the blur. With it 95 % ellipsoids hold for cameras
    # that code with powers of 1.8 to 2.6, taken for 2.2, and for colours that JPEG blurs (docs/vision-measured.md).
    floor_px: float = 0.06

    # Circles: Peng et al. 2020, Sec. III-A: Canny edges in the enlarged colour mask, bisected Hough threshold.
    rim_colour: float = 0.25  # of the ring inside a circle must have the colour (the paper's 25 %)
    working_radius_px: float = 12.0  # pictures are scaled to this radius, so that one Hough setting serves all sizes
    blurs_px: tuple[float, ...] = (1.0, 1.6, 2.4)  # the next one only where the number of circles jumps
    canny: tuple[float, float] = (20.0, 50.0)  # grey levels: low, so that the colour mask decides and not the edges
    accumulator: tuple[float, float] = (4.0, 100.0)  # where the bisection starts: everything, and nothing, is a circle
    accumulator_step: float = 1.0  # where it ends

    # Search around a prediction, and in whole pictures.
    margin: float = 1.3  # times the radius, around the window of a prediction
    disc_colour: float = 0.25  # of the disc must have the colour; another ball may hide the rest
    sure_arc: float = 0.8  # an outline at the prediction with this much rim,
    sure_size: float = 0.1  # a radius this near to the predicted one
    sure_colour: float = 0.5  # and this much of the colour is taken without a search
    sizes: tuple[float, float] = (0.006, 0.25)  # radii of unknown balls, of the picture's height
    least_search_px: float = 3.0  # least radius of an unknown ball
    patches: int = 30  # of colour, the roundest ones, that may be a ball themselves
    regions: int = 6  # of those, how many may hold one beside other things: each takes as long as a tracked frame
    saturations: tuple[float, ...] = (0.0, 0.15, 0.3, 0.42)  # added to the least one: backgrounds of the ball's own hue


@dataclass(frozen=True)
class AgreementSettings:
    """When several cameras agree on a ball in space about which nothing was known."""

    reprojection_px: float = 3.0  # twice the limit of a tracked ball: outlines of a first search are coarser
    size: float = 0.3  # by which two cameras' radii of one ball may differ, as a fraction
    distinct: float = 0.003  # m between two places that are two: a third of the smallest ball's diameter
    places: int = 4  # places a ball that are combined with the other balls'
    shape: float = 0.0015  # m by which distances between balls may miss: what outlines of a first search leave,
    shape_fraction: float = 0.04  # and as a fraction of them: fixtures are printed or glued
    still: float = 0.001  # m: a ball that moved less between two searches lies still; ten times what noise moves it
    near: float = 0.015  # m from where it is expected, it is the ball without having moved: less than its size
    fastest: float = 0.5  # m/s: what is farther apart in two searches is not one ball


@dataclass(frozen=True)
class ViewSettings:
    """When a camera's view of a ball is suspended, and how it comes back (Peng et al. 2020, Sec. III-B)."""

    motion_px: float = 16.0  # a circle farther than this from its prediction is not the ball; times the tolerance
    radius: float = 0.25  # fraction by which the radius may differ from the predicted one; times the tolerance
    reprojection_px: float = 1.5  # farther than this from where the other cameras put it, a view is suspended
    return_px: float = 0.75  # nearer than that limit a suspended view must be to come back: half, so that it stays then
    good_frames: int = 5  # agreeing frames that bring a view back (the paper's five)
    widen: float = 1.5  # factor a frame on the tolerance while fewer than two cameras see a ball (the paper widens too)
    widest: float = 6.0  # its limit: about 100 px of motion
    patience: int = 5  # frames between two searches of whole pictures, which take ten times as long as a tracked frame
    spread_memory: float = 15.0  # frames over which the scatter of views about their poses is averaged: half a second
    # Chi squared of the trusted views (a mean, or a recording's median) above which they disagree themselves, so that
    # the suspended ones may be right: an outsider's good recordings left 0.35, cropped or moved cameras 3.9 to 17.
    doubt: float = 2.0
    size_memory: int = 60  # frames over which the radius of a ball of unknown size is the median: two seconds


@dataclass(frozen=True)
class MotionSettings:
    """How the tool may move between frames."""

    acceleration: float = 1.5  # m/s^2, standard deviation; large, so that measured poses are hardly smoothed
    angular_acceleration: float = 20.0  # rad/s^2
    usual_acceleration: float = 0.5  # m/s^2, standard deviation; of the velocity with which late views are moved back
    usual_angular_acceleration: float = 5.0  # rad/s^2
    shows_speed: int = 3  # measured frames after which the velocity is known
    coast: float = 0.5  # s without measurement after which the tool is lost
    gate: float = 60.0  # squared Mahalanobis distance: chance of a true pose (chi^2, 6) beyond it is 5e-11
    surprise: float = 12.6  # the same, chance 5 %: such a pose is believed, the velocity that leads to it is not
    stubborn: int = 3  # frames in a row after which a pose beyond the gate is believed
    start_speed: float = 0.5  # m/s, standard deviation of a velocity about which nothing is known
    start_turn: float = 5.0  # rad/s


@dataclass(frozen=True)
class ClockSettings:
    """What is known of when each camera looks."""

    unknown: float = 0.015  # s, standard deviation: half a frame of webcams that run freely at 30 a second
    start_speed: float = 0.1  # m/s: of a tool whose velocity has not shown yet; views may disagree by that
    known: float = 1e-4  # s: of a delay that the calibration file states, and of the first camera
    shown: float = 4.0  # standard deviations from none: most cameras are triggered together, and then none is right
    look: int = 45  # frames at the beginning of a recording that are tracked twice: the first time for the delays
    memory: float = 90.0  # frames: what was learned from a first, wrong velocity fades in three seconds
    least_speed: float = 0.01  # m/s: below, errors of the velocity would be taken for knowledge of the delays
    reach: int = (
        3  # frames before and after one by which its motion is interpolated: a tenth of a second at 30 a second
    )
    off_px: float = 0.1  # by which a picture is shifted, turned and scaled at its rim, as a calibration may leave it,
    widest_px: float = 0.5  # and where one does not fit; 1.5 leaves delays open for longer


@dataclass(frozen=True)
class CheckSettings:
    """When a recording is refused before tracking, and what is remarked on after it."""

    frames: int = 7  # spread over the recording; the balls may be hidden in some
    # Of the views agree: no reason to doubt. Less makes no other order of the cameras the true one: among 24 orders of
    # four cameras there is often one in which two of them, half of the views, agree on every ball by chance.
    enough: float = 0.75
    better: float = 1.25  # times as many agreeing views (and two more) make another order of the cameras the true one
    some: float = 0.34  # of the views must agree
    few_views: float = 1.5  # cameras a ball and frame, on average: with fewer, nothing speaks against the calibration
    most_ordered: int = 5  # cameras of which all orders (120) are tried; of more, only swaps of two
    order_frames: int = 3  # frames with which orders are compared,
    order_candidates: int = 6  # and of every ball in a picture the likeliest ones
    radius: float = 0.25  # fraction by which a ball's radius may differ from the target file's
    often: float = 0.3  # of the frames in which a camera contradicts the others, or adds nothing: it is named
    # How far the distance between two balls, a median over half a second, may miss the target's before it is remarked
    # on: standard deviations of the poses (rendered good targets left 3.4, one with a ball 3 mm off 4.9), and m (JPEG
    # pictures of good targets left 0.25 mm; a caliper measures no better).
    misshapen: float = 3.0
    misshapen_least: float = 0.0003


@dataclass(frozen=True)
class CalibrationSettings:
    """Which boards, points and poses are believed in a calibration."""

    # Lens from boards.
    fewest_boards: int = 3  # Zhang 2000: three views determine all intrinsics
    bad_board: float = 4.0  # times the median board's error,
    bad_board_px: float = 0.5  # and at least this: left out
    k3_gain: float = 10.0  # by which twice the log likelihood must rise for k3 (BIC: log of some 10^4 coordinates)
    # Pose from known points.
    fewest_points: int = 6  # the linear solution needs six
    outlier: float = 4.0  # standard deviations by the median absolute residual
    outlier_px: float = 1.0  # nothing nearer is an outlier
    outlier_width: float = 0.015  # of the picture's width: what is farther off is one whatever the others are
    least_noise_px: float = 0.01  # no corner is taken for better: it would outweigh all others
    # Against the rough pose.
    far: float = 0.15  # m from where the board says that the camera stands: markers were mixed up
    turned: float = float(np.deg2rad(25.0))  # rad
    bad_rms_px: float = 5.0  # reprojection error at which the markers are not these markers
    same: float = 0.01  # m between two poses that are one
    # Markers in a picture.
    marker_reach_px: float = 40.0  # how far from its expected pixel
    marker_near_px: tuple[float, ...] = (12.0, 6.0, 3.0)  # and from the offset of all markers, round by round
    marker_trials: int = 10  # offsets that are tried, the likeliest ones
    marker_radii_px: tuple[float, ...] = (2.0, 2.8, 4.0, 5.6, 8.0, 11.0)  # of dots that are looked for
    marker_answer: float = 3.0  # grey levels of a difference of Gaussians: a dot that stands out by ten has it
    marker_strong: float = 12.0  # the same; a dot that stands out by forty counts fully
    marker_blobs: int = 250  # of a kind, the strongest ones
    marker_roundness: float = 0.15  # least curvature over greatest: a post is a ridge, with none along it
    # of markers found in a picture, with a lens from boards: beyond it they are other things
    marker_rms_px: float = 1.0
    marker_shift: float = 1.0  # of its radius: a rim whose middle is farther from its blob's is another's


@dataclass(frozen=True)
class VisionSettings:
    """All of them: single pictures, several cameras, views over time, motion, clocks, checks and calibration."""

    balls: BallSettings = field(default_factory=BallSettings)
    agreement: AgreementSettings = field(default_factory=AgreementSettings)
    views: ViewSettings = field(default_factory=ViewSettings)
    motion: MotionSettings = field(default_factory=MotionSettings)
    clocks: ClockSettings = field(default_factory=ClockSettings)
    check: CheckSettings = field(default_factory=CheckSettings)
    calibration: CalibrationSettings = field(default_factory=CalibrationSettings)


DEFAULT = VisionSettings()
