"""Where the tool is, seen by ordinary cameras: calibration, balls, pose over time. The only room that knows OpenCV."""

from gpcorrect.vision.annotate import AnnotatedVideo, annotated
from gpcorrect.vision.bundle import adjust
from gpcorrect.vision.calibrate import CalibrationReport, CameraReport, calibrate_rig
from gpcorrect.vision.camera import Camera, Intrinsics
from gpcorrect.vision.camera_file import read_cameras, write_cameras
from gpcorrect.vision.chessboard import Chessboard, find_corners
from gpcorrect.vision.colour import COLOURS, Colour, colour_of
from gpcorrect.vision.filtering import Filtered, FilterSettings, PoseFilter
from gpcorrect.vision.lens import calibrate_lens
from gpcorrect.vision.place import Placement, poses_from_board, poses_from_points, refine_pose
from gpcorrect.vision.pose import Sightings, pose_closed_form, pose_from_sightings, pose_nelder_mead
from gpcorrect.vision.recording import STATUSES, Track
from gpcorrect.vision.rig_file import Rig, read_rig
from gpcorrect.vision.rim import Outline, outline
from gpcorrect.vision.sources import Source, open_source
from gpcorrect.vision.target import END_EFFECTOR, BallSpec, Target, read_target, single_ball, target_from_dict
from gpcorrect.vision.track import TrackResult, TrackSettings, track
from gpcorrect.vision.tracker import Frame, Tracker
from gpcorrect.vision.triangulate import common_perpendicular, mean_midpoint, triangulate
from gpcorrect.vision.views import REASONS, FrameRules

__all__ = [
    "COLOURS",
    "END_EFFECTOR",
    "REASONS",
    "STATUSES",
    "AnnotatedVideo",
    "BallSpec",
    "CalibrationReport",
    "Camera",
    "CameraReport",
    "Chessboard",
    "Colour",
    "FilterSettings",
    "Filtered",
    "Frame",
    "FrameRules",
    "Intrinsics",
    "Outline",
    "Placement",
    "PoseFilter",
    "Rig",
    "Sightings",
    "Source",
    "Target",
    "Track",
    "TrackResult",
    "TrackSettings",
    "Tracker",
    "adjust",
    "annotated",
    "calibrate_lens",
    "calibrate_rig",
    "colour_of",
    "common_perpendicular",
    "find_corners",
    "mean_midpoint",
    "open_source",
    "outline",
    "pose_closed_form",
    "pose_from_sightings",
    "pose_nelder_mead",
    "poses_from_board",
    "poses_from_points",
    "read_cameras",
    "read_rig",
    "read_target",
    "refine_pose",
    "single_ball",
    "target_from_dict",
    "track",
    "triangulate",
    "write_cameras",
]
