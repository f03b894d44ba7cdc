"""Choices of a simulation, by name."""

DRIVES = ("kinematic", "physics")
"""How a robot executes actions: exactly, or by wheel torque and contact."""
POSES = ("true", "odometry")
"""Source of the poses in observations: the simulator, or the wheels alone."""
