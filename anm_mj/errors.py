"""Errors that a user can cause and fix; each message names the problem, the value and the remedy.

The command line turns every :class:`AnmError` into one sentence and exit status 2. The expected ends of a run are
values (:class:`anm_mj.types.StopReason`), not errors.
"""


class AnmError(Exception):
    """Base class of all errors that a user can cause and fix."""


class InstallError(AnmError):
    """The package is not installed as a whole: its compiled module is missing or cannot run on this processor."""


class ConfigError(AnmError):
    """A setting or an option has a value that it cannot have."""


class SceneError(AnmError):
    """A scene cannot be read, imported or built, or the robot cannot start in it."""


class RenderError(AnmError):
    """No image can be rendered: no GL back-end works, or a camera is missing."""


class MapError(AnmError):
    """The neural map cannot be trained, queried or loaded (non-finite loss, unknown device, foreign checkpoint)."""


class PlanError(AnmError):
    """A policy cannot be made (unknown name, a class that is no policy), or its plan is invalid."""


class RobotError(AnmError):
    """A robot model lacks a part, or a drive refuses it or a motion."""


class TaskError(AnmError):
    """An environment's task gets an unknown option, an invalid value or an invalid action."""


class RunFolderError(AnmError):
    """A run folder or a recorded sequence cannot be written or read."""


class BenchError(AnmError):
    """A comparison cannot be made from its file, or its folder cannot be used."""


class CheckpointError(AnmError):
    """A run cannot be continued: it has no checkpoint, a damaged one, or state that cannot be stored."""
