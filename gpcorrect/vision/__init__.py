"""Where the tool is, seen by ordinary cameras: calibration, balls, pose over time. The only user of OpenCV."""

from gpcorrect.vision.annotate import AnnotatedVideo, LiveView, annotated, side_by_side
from gpcorrect.vision.boards import Chessboard, calibrate_lens, find_corners, rig_text
from gpcorrect.vision.calibrate import CalibrationReport, calibrate_rig
from gpcorrect.vision.camera import Camera, Intrinsics
from gpcorrect.vision.checks import check_fit
from gpcorrect.vision.files import Rig, read_cameras, read_rig, read_target, write_cameras
from gpcorrect.vision.filtering import PoseFilter, Status
from gpcorrect.vision.place import adjust, poses_from_board, refine_pose
from gpcorrect.vision.pose import (
    Observations,
    common_perpendicular,
    mean_midpoint,
    pose_closed_form,
    pose_from_observations,
    triangulate,
)
from gpcorrect.vision.record import record
from gpcorrect.vision.rim import Outline, outline
from gpcorrect.vision.search import REASONS, Reason
from gpcorrect.vision.settings import VisionSettings
from gpcorrect.vision.sources import Source, open_source, open_sources
from gpcorrect.vision.target import END_EFFECTOR, BallSpec, Colour, Target, colour_of, single_ball
from gpcorrect.vision.track import Track, TrackResult, TrackSettings, track
from gpcorrect.vision.tracker import Frame, Tracker

__all__ = [
    "END_EFFECTOR",
    "REASONS",
    "AnnotatedVideo",
    "BallSpec",
    "CalibrationReport",
    "Camera",
    "Chessboard",
    "Colour",
    "Frame",
    "Intrinsics",
    "LiveView",
    "Observations",
    "Outline",
    "PoseFilter",
    "Reason",
    "Rig",
    "Source",
    "Status",
    "Target",
    "Track",
    "TrackResult",
    "TrackSettings",
    "Tracker",
    "VisionSettings",
    "adjust",
    "annotated",
    "calibrate_lens",
    "calibrate_rig",
    "check_fit",
    "colour_of",
    "common_perpendicular",
    "find_corners",
    "mean_midpoint",
    "open_source",
    "open_sources",
    "outline",
    "pose_closed_form",
    "pose_from_observations",
    "poses_from_board",
    "read_cameras",
    "read_rig",
    "read_target",
    "record",
    "refine_pose",
    "rig_text",
    "side_by_side",
    "single_ball",
    "track",
    "triangulate",
    "write_cameras",
]
