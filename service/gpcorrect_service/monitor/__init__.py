"""A local page to watch arms and their corrections: it reads, and changes nothing."""

from gpcorrect_service.monitor.board import Board
from gpcorrect_service.monitor.watcher import Watcher

__all__ = ["Board", "Watcher"]
