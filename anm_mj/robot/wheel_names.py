"""Tells by its name which side of a robot a wheel is on."""

import re

_WHEEL = {"wheel", "wheels", "whl", "drivewhl", "tire", "tyre"}
_LEFT = {"left", "l", "lh", "lft", "port", "fl", "rl", "bl", "ml", "lf", "lb", "lr"}
_RIGHT = {"right", "r", "rh", "rgt", "starboard", "fr", "rr", "br", "mr", "rf", "rb"}
_PASSIVE = {"caster", "castor", "suspension", "steer", "steering", "swivel", "roller", "ball", "omni"}
_WORDS = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+")
_PREFIXES = ("left", "right", "wheel")
_ENDINGS = ("wheel", "caster", "castor")


def side_of(name: str) -> str:
    """``left`` or ``right`` for the name of a wheel on that side; ``wheel`` for another wheel; else empty.

    ``joint_left_wheel``, ``wheel_left_joint``, ``leftWheel``, ``fl_wheel``, ``robot/l_wheel_joint`` are left wheels.
    Casters, suspensions and steering joints are none.
    """
    words = set(_words(name))
    if words & _PASSIVE or not words & _WHEEL:
        return ""
    left, right = bool(words & _LEFT), bool(words & _RIGHT)
    if left == right:
        return "wheel"
    return "left" if left else "right"


def is_passive(name: str) -> bool:
    """Whether a name is that of a caster, a suspension or a steering joint."""
    return bool(set(_words(name)) & _PASSIVE)


def _words(name: str) -> list[str]:
    """Lower-case words of a name; words written together, such as ``leftwheel``, are split."""
    found = []
    for word in (match.lower() for match in _WORDS.findall(name)):
        while prefix := next((p for p in _PREFIXES if word.startswith(p) and word not in (p, "wheels")), None):
            found.append(prefix)
            word = word[len(prefix) :]
        ends_in = next((end for end in _ENDINGS if word.endswith(end) and word != end), None)
        found += [word[: -len(ends_in)], ends_in] if ends_in else [word]
    return found
