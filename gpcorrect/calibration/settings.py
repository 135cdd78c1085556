"""Settings of a fit, and the numbers that decide in every task."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, get_args

from gpcorrect.cleaning import CleaningSettings
from gpcorrect.errors import DataError
from gpcorrect.rigid import MarkerOption

Direction = Literal["estimate", "command"]
InputSignal = Literal["measured_jp", "setpoint_jp"]

MEMORY = "memory"  # name of the features that say where in its slack the arm is, in every task

JOINTS = "joints"  # poses: name of the features that the arm's joints are, with their velocities and memory


@dataclass(frozen=True)
class FitSettings:
    """Settings of a fit of any task; a task reads those that concern it.

    Parameters
    ----------
    method : str, A learner of :data:`gpcorrect.calibration.LEARNERS`
    features : tuple of str
        What the learner sees; empty for the task's own choice. Poses: "pose" (or "euler": the angles of Mahler et al.
        2014), "velocity", "memory" or "joints" (which have a memory of their own); their own choice takes joints, or
        else memory, where that helps. Joints and tool position: "position", "velocity", "acceleration", "effort",
        "memory", "lags", "state".
    clean : bool, reject faulty samples first
    cleaning : CleaningSettings, limits of the cleaning
    time_offset : str, clock of the outside sensor: "auto", "none", or seconds by which its stamps run ahead
    inducing : int or None, points that the Gaussian process rests on; the task's own number when None
    search_samples : int or None
        Samples from which the Gaussian process learns its hyperparameters, which takes most of a fit; its own number
        when None.
    layers : tuple of int, widths of the network
    epochs : int, passes of the network over the data
    seed : int, seed of everything random
    rigid : bool, poses: register frames first; without it the regression learns from the observed pose as it is
    marker : str, poses: "none", "solve" or "auto": whether the marker may be away from the tool tip
    input_signal : str or None, joints: "measured_jp" or "setpoint_jp"; the first that is logged when None
    direction : str, joints: "estimate" (from reported to true) or "command" (from desired true to commanded)
    end_to_end : bool, joints: learn the true positions themselves, not the error
    extra : tuple of str, tool position: extra columns of the log that belong to the state
    """

    method: str = "gp"
    features: tuple[str, ...] = ()
    clean: bool = True
    cleaning: CleaningSettings = field(default_factory=CleaningSettings)
    time_offset: str = "auto"
    inducing: int | None = None
    search_samples: int | None = None
    layers: tuple[int, ...] = (100, 100)
    epochs: int = 200
    seed: int = 0
    rigid: bool = True
    marker: MarkerOption = "auto"
    input_signal: InputSignal | None = None
    direction: Direction = "estimate"
    end_to_end: bool = False
    extra: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name, value, known in (
            ("direction", self.direction, get_args(Direction)),
            ("input_signal", self.input_signal, (None, *get_args(InputSignal))),
        ):
            if value not in known:
                raise DataError(f"{name} is one of {', '.join(map(str, known))}; got {value!r}.")
        counts = {"inducing": self.inducing, "search_samples": self.search_samples, "epochs": self.epochs}
        counts |= {"layers": min(self.layers, default=1)}
        for name, count in counts.items():
            if count is not None and count < 1:
                raise DataError(f"{name} must be at least 1, got {count}.")


@dataclass(frozen=True)
class Limits:
    """Numbers that decide whether a log is learned from, and how far an answer may go."""

    # complete samples below which nothing is learned: fewer do not fill one fold of four with a motion. Chosen by hand.
    fewest_samples: int = 20
    few_recorded: int = 30  # samples that a person is told to record who has fewer: four fifths of them are enough
    # largest believed correction over the largest in training: a query between training poses may need a little more
    # than any of them. Chosen by hand; half of it (no headroom) cut 0.1 % of held-out simulated answers.
    headroom: float = 1.5
    # per cent of each input in training between which its range lies: a few wild velocities do not widen it. Chosen by
    # hand.
    range_quantiles: tuple[float, float] = (0.5, 99.5)
    margin: float = 0.5  # fraction of an input's range that a query may lie beyond it; chosen by hand
    # part of the way from the middle of the region to its edge by which rates begin to fade, however far training went:
    # halfway through the margin. Chosen by hand.
    fades_from: float = 0.75
    # motions (or pieces of `piece_seconds` of a longer one) below which a fit says that they are few: intervals are
    # then widened by more than a quarter
    enough_motions: int = 9
    # Commanded orientations that lie less than so many times as far about their mean as the robot misses them are not
    # learned from: of a tilt asked for, regression passes on c^2 / (c^2 + m^2), with spreads c of what is commanded and
    # m of what is missed, and claims errors sqrt(c^2 / (c^2 + 2 m^2)) of the real ones. At 1 half a tilt is undone, and
    # 0.58 of the error claimed; an answer that leaves the orientation as it is misses no more.
    least_turning: float = 1.0
    # m from the marker to the tool tip that intervals allow for where the orientation was held: it cannot be
    # observed then, and an asked turn by 1 deg moves the marker by 0.9 mm. Chosen by hand, of usual mountings.
    unseen_lever: float = 0.05
    # Sessions that lie apart are said where chance makes it so in one log of a thousand, and the variance between them
    # is so much of that of left-out errors: frames moved by 5 to 9 mm on simulated arms make 0.85 to 0.89, a homing
    # 0.64; none of eight logs of one frame and homing, real ones among them, reaches 0.03.
    apart_chance: float = 1e-3
    apart_fraction: float = 0.25
    # of a session, that cleaning rejects as no fault of single samples does: cleaning itself holds up to half
    lost_session: float = 0.5
    # fraction of a held-out error of poses that learning must take away not to be called in vain: less is what a tool
    # that moved or two clocks leave of it, and no planner is the better for it. Chosen by hand.
    least_lessened: float = 0.1
    # s that a sensor may be later than in the training without a word, or its interval if that is wider: play and pace
    # move what is found by some milliseconds. Chosen by hand.
    other_clock: float = 0.01
    # of the median error, that shifting must take away for a clock to be spoken of: 14 ms and 30 ms that were planted
    # take away a fifteenth and more, faster motion or another tool, found as 14 and 12 ms, nothing
    clock_explains: float = 0.05
    # of the squared residuals of other trajectories, that a marker off the tip must explain for it to be said: one
    # 6 cm away explains 0.75 to 0.91 on simulated arms, none at the tip, real recordings among them, more than 0.12
    lever_explains: float = 0.5
    # of the squared errors of a linear law of pose and velocity, that memory beside them must take away to be learned
    # unasked, and the fraction of the errors that it must then take away to be used: about half of it arrives when a
    # machine is driven by the answers. Taken away in position and rotation, and in closed loop: a simulated RAVEN-II
    # (explained 0.15) 6 and 4 %, -5 and -2 %; a tendon arm 11 and -2 %, 0 and -3 %, with four times its slack 19 and 5
    # %, 5 and -2 %; a continuum robot 55 and 60 %, 29 and 25 %; machines of bench/pose_peers.py: gantry (0.45) 23 and
    # 25 %, 8 and 12 %; tendons (0.27) 22 and 6 %, 22 and 7 %
    memory_explains: float = 0.1
    memory_lessens: float = 0.1
    folds: int = 4  # parts of neighbouring trajectories that are left out in turn; chosen by hand
    # from which whole ones are left out: of two, half of the recording would be
    fewest_sessions: int = 3
    # length of the pieces, s, whose errors are ranked against each other in the test for ageing. Chosen by hand.
    piece_seconds: float = 20.0
    # a wait longer than so many usual steps, and than so many seconds, ends a path: the arm may have been moved. A
    # shorter one is a way straight on, as to the next of motions that are logged one by one. With 1 s an outsider's
    # wrist, 1 s between motions, was 1.76 times as wrong at joint 1 as the best of simple laws, with 10 s 1.03 times
    pause_steps: float = 20.0
    pause_seconds: float = 10.0
    # a query beyond the training's range by more than so many of its sizes, and than so many m or rad, is refused. A
    # unit's factor is 57 or 1000, a workspace away from the origin by a few of its sizes.
    far_sizes: float = 10.0
    far_least: float = 1.0
    far_away: float = 10.0  # m from the base at which no tool is: in millimetres every tool is farther than that
    # a path of samples at least so many s apart, so many times slower than the training, that travels so much of the
    # training's size, is refused: milliseconds taken for seconds are 1000 times slower. Paths at half and at twice the
    # training's speed, and at a tenth, are not refused (tested).
    slow_step: float = 0.5
    slow_ratio: float = 100.0
    slow_travel: float = 0.01
    # steps of joints so many times faster than nine tenths of the training's are none that an arm makes. Those of the
    # real recordings reach 5; an encoder's spike of 0.3 rad at 100 Hz is 30. Chosen by hand between.
    leap_speeds: float = 10.0
    leap_least: float = 1e-4  # m or rad: of a joint that moved less in training, the range says nothing of its steps


LIMITS = Limits()
