"""Commands that others give a run on a live robot: start, pause, stop, save, home."""

import logging
import threading
from collections.abc import Callable
from pathlib import Path

from anm_mj.events import Observed, Stepped
from anm_mj.io.run_events import Started
from anm_mj.io.run_folder import RunFolder
from anm_mj.io.write import writing
from anm_mj.loop_state import LoopState
from anm_mj.mapping.neural_map import NeuralMap
from anm_mj.planning.policies.return_to_start import ReturnToStart
from anm_mj.ros.node import STATE, Node
from anm_mj.ros.services import serve_trigger
from anm_mj.utils.files import atomic_write

TOPIC = "explore/command"
COMMANDS = ("start", "pause", "stop", "save", "home")
_LOOK_S = 0.05

_logger = logging.getLogger(__name__)


class Control:
    """An observer of the loop that obeys commands between two steps.

    They come as ``std_msgs/String`` on ``explore/command``, or by the services ``explore/start`` and so on of type
    ``std_srvs/Trigger``.
    """

    def __init__(self, node: Node, mapper: NeuralMap, policy: ReturnToStart, state: LoopState, *, waits: bool) -> None:
        """Listen; ``policy`` is sent home, which ends the plan in the loop's ``state``. The first action ``waits`` for
        ``start``, or not.
        """
        self._mapper, self._policy, self._state = mapper, policy, state
        self._run = threading.Event()
        if not waits:
            self._run.set()
        self.is_over = False
        """Whether the run was stopped."""
        self.on_pause: Callable[[], None] = lambda: None
        """Called when a pause begins: stops a robot that drives on between two actions."""
        self.last = ""
        """The last command, and what it does."""
        self._save = self._home = False
        self._folder: Path | None = None
        node.subscribe(TOPIC, "std_msgs/msg/String", lambda message, _: self._obey(message.data), STATE)
        for name in COMMANDS:
            serve_trigger(node, f"explore/{name}", lambda name=name: self._obey(name))

    def on_event(self, event: object) -> bool:
        """Do what was asked for; whether the run is to end. See :class:`anm_mj.events.Observer`."""
        if isinstance(event, Started):
            self._folder = event.folder
        elif isinstance(event, Observed | Stepped):
            if not self._run.is_set():
                self.on_pause()
            while not self._run.wait(_LOOK_S) and not self.is_over:
                self._do(event)
            self._do(event)
        return self.is_over

    def _do(self, event: object) -> None:
        if self._save and self._folder is not None:
            self._save, path = False, RunFolder(self._folder).map
            with writing(path), atomic_write(path) as partial:
                self._mapper.save(partial)
            _logger.info("The map is saved in %s.", path)
        if self._home and isinstance(event, Stepped):
            self._home = False
            self._policy.end("asked to go home", event.step)
            self._state.follower.drop()

    def _obey(self, command: str) -> tuple[bool, str]:
        """Note a command; success, and what to say."""
        if command not in COMMANDS:
            raise ValueError(f"'{command}' is no command; send one of {', '.join(COMMANDS)}")
        if command == "start":
            self._run.set()
        elif command == "pause":
            self._run.clear()
        elif command == "stop":
            self.is_over = True
        elif command == "save":
            self._save = True
        else:
            self._home = True
            self._run.set()
        _logger.info("%s: %s.", TOPIC, command)
        does = {"start": "goes on", "pause": "pauses after this step", "stop": "ends after this step"}.get(
            command, "done after this step"
        )
        self.last = f"{command}: {does}"
        return True, does
