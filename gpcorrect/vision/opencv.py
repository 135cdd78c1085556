"""OpenCV, or the sentence that says how to get it: the only import of it."""

from __future__ import annotations

import importlib
from typing import Any

from gpcorrect.errors import MissingExtraError

Image = Any  # (height, width, 3) uint8, blue green red, as OpenCV reads it


try:
    cv2: Any = importlib.import_module("cv2")
except ImportError as error:
    raise MissingExtraError("OpenCV", extra="vision", purpose="Tracking by cameras") from error
