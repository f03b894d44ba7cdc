"""What can go wrong by a user's doing: each error says what is wrong, with the value, and what to do.

The command line turns every :class:`AnmError` into one sentence and exit status 2. Expected endings of a run are not
errors but values (:class:`anm_mj.types.StopReason`).
"""


class AnmError(Exception):
    """Root of all errors that a user can cause and mend."""


class SceneError(AnmError):
    """A scene cannot be read, imported, built or started in."""


class RenderError(AnmError):
    """No picture can be made: no GL back-end works, or a camera is missing."""


class MapError(AnmError):
    """The neural map cannot be trained or queried (a non-finite loss, an unknown device, a foreign checkpoint)."""


class PlanError(AnmError):
    """A policy cannot be made (an unknown name, a class that is not a policy)."""


class RobotError(AnmError):
    """A robot model lacks a part, or a drive cannot be made from it."""


class TaskError(AnmError):
    """An environment's task cannot be made, or is asked for what it does not offer (an unknown option, no action)."""


class RunFolderError(AnmError):
    """A run folder cannot be written or read."""
