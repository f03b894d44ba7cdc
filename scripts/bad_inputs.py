"""Feed damaged and hostile files to every reader, and say which ones it does not take well.

Every case runs in a process of its own, with 20 s of the processor and 2 GiB. A case passes if the command ends well,
or says in one sentence what is wrong and exits with status 2, and nothing outside its output folder changed.
"""

from __future__ import annotations

import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from itertools import islice
from pathlib import Path

from anm_mj.cli.command_line import run_script

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tests.corpus.check import Checker, all_cases
from tests.corpus.hostile_cases import ROBOT
from tests.corpus.sources import write_sources


def main(only: str = "", per_file: int = 8, seed: int = 0, every: int = 1, skip: int = 0) -> None:
    """Run the corpus and print a line per case that fails, and a table; Ctrl-C gives the table so far.

    Args:
        only: run the cases whose name contains this.
        per_file: changes of each sort per file.
        seed: of the changes.
        every: run one case in so many.
        skip: leave out so many of all cases, to go on where an earlier call was stopped.
    """
    signal.signal(signal.SIGINT, signal.default_int_handler)
    root = Path(tempfile.mkdtemp(prefix="bad_inputs_"))
    total, failed = Counter[str](), Counter[str]()
    try:
        good = write_sources(root / "good", ROBOT)
        checker = Checker(good, root)
        cases = (case for case in all_cases(good, checker.canary, seed, per_file) if only in case.name)
        began = time.monotonic()
        try:
            for case in islice(cases, skip, None, every):
                fault = checker.fault(case)
                total[case.kind] += 1
                if fault:
                    failed[case.kind] += 1
                    print(f"{case.name}: {fault}", flush=True)
        except KeyboardInterrupt:
            print("Interrupted; so far:")
        for kind, count in total.items():
            print(f"{kind:10s} {count:5d} cases, {failed[kind]} not taken well")
        print(f"{total.total()} cases, {failed.total()} not taken well, {time.monotonic() - began:.0f} s")
    finally:
        shutil.rmtree(root)
    raise SystemExit(bool(failed.total()))


if __name__ == "__main__":
    run_script(main)
