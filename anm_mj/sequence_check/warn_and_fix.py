"""The check as ``anm-mj map`` does it: look at some frames, warn, and put right what was asked for."""

import logging
from dataclasses import dataclass, field, replace

from anm_mj.errors import ConfigError
from anm_mj.io.sequence import Sequence
from anm_mj.sequence_check.corrected_sequence import corrected_sequence
from anm_mj.sequence_check.correction import Correction, combined
from anm_mj.sequence_check.evidence import gather
from anm_mj.sequence_check.find_faults import Verdict, find_faults
from anm_mj.sequence_check.report import explanation, options

_logger = logging.getLogger(__name__)


@dataclass
class BeforeMapping:
    """Judges a sequence once its files are read, and before its floor is looked for."""

    given: Correction = field(default_factory=Correction)
    """Applied first: what the command line says."""
    fix: bool = False
    """Whether findings are applied, too."""
    keeps_up: bool = False
    """Whether the axis that points up was given."""
    verdict: Verdict | None = None
    """After the call; None where too little could be read, or there are no poses."""
    applied: tuple[str, ...] = ()
    """Options that ``fix`` stands for, after the call."""

    def __call__(self, sequence: Sequence, up: str) -> tuple[Sequence, str]:
        """The sequence put right, and the axis that points up. Raises ConfigError if a correction of poses was given
        for a sequence without any.
        """
        if not sequence.has_poses:
            wrong = self.given.changes().keys() & {"convention", "axes", "pose_scale", "time_offset_s"}
            if wrong:
                raise ConfigError(
                    f"{sequence.path} has no poses; leave out what corrects them ({', '.join(sorted(wrong))})."
                )
            return corrected_sequence(sequence, self.given), up
        # A convention and axes are found in place of the given ones, all else on top.
        before = replace(self.given, convention=Correction.convention, axes=Correction.axes)
        prepared = corrected_sequence(sequence, before)
        evidence = gather(prepared)
        if evidence is None:
            return corrected_sequence(sequence, self.given), up
        self.verdict = find_faults(
            evidence,
            depth_unit_m=prepared.depth_unit_m,
            up=None if self.keeps_up else up,
            start=Correction(self.given.convention, self.given.axes),
        )
        if not self.verdict.findings:
            self._say(sequence, [])
            return corrected_sequence(sequence, self.given), up
        correction = combined(before, self.verdict.correction)
        words = options(correction, sequence, self.given)
        self._say(sequence, words)
        if not self.fix:
            return corrected_sequence(sequence, self.given), up
        self.applied = tuple(words)
        return corrected_sequence(sequence, correction), correction.up or up

    def _say(self, sequence: Sequence, words: list[str]) -> None:
        assert self.verdict is not None, "the sequence was judged"
        for finding in self.verdict.findings:
            shares = (
                f"{100 * finding.before:.0f} % of the compared points fit without it and {100 * finding.after:.0f} %"
            )
            after = "" if finding.kind == "up" else f"; {shares} with it"
            _logger.warning("%s does not fit together: %s%s.", sequence.path, explanation(finding), after)
        if words:
            done = " (applied, --fix)" if self.fix else ", or --fix"
            _logger.warning("This puts it right: %s%s.", " ".join(words), done)
        if self.verdict.contradicts:
            _logger.warning(
                "Depth and poses of %s contradict each other: only %.0f %% of the points that frames share fit, and "
                "nothing that was tried explains it. The map will be wrong. Check poses, camera and clock, or find the "
                "poses by --track.",
                sequence.path,
                100 * self.verdict.corrected.fitting,
            )
