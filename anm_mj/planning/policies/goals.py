"""What a run is for."""

GOALS = ("coverage", "reconstruction", "both")
"""To see all surface; to know it well; first the one, then the other."""
DEFAULT_GOAL = "both"
