"""Whether depth, poses, camera and clock of a recorded sequence fit together, and if not, what would."""
