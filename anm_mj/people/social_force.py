"""The force between people: an exponential of the distance between their bodies, weaker for what lies behind."""

import math

_PUSH_MPS2, _PUSH_M = 25.0, 0.08
"""Strength and reach: 2000 N on 80 kg (Helbing, Farkas and Vicsek)."""
_BEHIND = 0.2
"""Share of a force that comes from straight behind."""
_ASIDE_RAD = math.radians(20.0)
"""People give way to their right: a force from straight ahead would only stop both."""


def push(dx: float, dy: float, apart_m: float, yaw_rad: float) -> tuple[float, float]:
    """Acceleration [m/s2] away from somebody at (dx, dy) [m] whose body touches from ``apart_m`` on."""
    away = max(math.hypot(dx, dy), 1e-6)
    ahead = (dx * math.cos(yaw_rad) + dy * math.sin(yaw_rad)) / away
    size = _PUSH_MPS2 * math.exp((apart_m - away) / _PUSH_M) * (_BEHIND + (1.0 - _BEHIND) * (1.0 + ahead) / 2.0)
    # Turned to the right-hand side where the other one is ahead.
    angle = math.atan2(-dy, -dx) + (_ASIDE_RAD if ahead > 0.0 else 0.0)
    return size * math.cos(angle), size * math.sin(angle)
