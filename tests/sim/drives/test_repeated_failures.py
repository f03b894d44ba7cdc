"""When a robot that does not get where it drives is given up."""

from anm_mj.sim.drives.repeated_failures import RepeatedFailures
from anm_mj.types import StopReason


def test_standing_still_at_an_obstacle_says_nothing_about_a_wheel_that_sticks():
    failures, still = RepeatedFailures(), (0.0, 0.0)
    faults = []
    for _ in range(6):
        fault = failures.after(failed=False, touched=False, driven_rad=(1.0, 1.0), turned_rad=(0.0, 1.0))
        faults.append(fault)
        failures.after(failed=False, touched=True, driven_rad=still, turned_rad=still)
    assert faults == [None] * 5 + [StopReason.WHEEL_STUCK]
