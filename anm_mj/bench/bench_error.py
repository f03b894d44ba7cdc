"""The error of comparisons."""

from anm_mj.errors import AnmError


class BenchError(AnmError):
    """A comparison cannot be made from its file, or its folder cannot be used."""
