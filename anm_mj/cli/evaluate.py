"""``anm-mj eval``: the metrics of a finished run."""

from pathlib import Path

from anm_mj.cli.command_line import Report
from anm_mj.cli.option_types import refuse_idle


def evaluate(
    run: Path, *, novel_views: bool = False, halved_intrinsics: bool = False, scene: str | None = None
) -> Report:
    """Recompute the metrics of a run from its folder alone, and write them anew.

    Args:
        run: a run folder
        novel_views: also evaluate the map on views from places the robot never visited, and on the scene's 200 fixed
            views
        halved_intrinsics: also print completion as the paper's code back-projects, half a pixel aside
        scene: with --novel-views: name or folder of the run's scene, if it has moved
    """
    from anm_mj.cli.console import PlainConsole, progress_bar
    from anm_mj.cli.progress import ProgressLine
    from anm_mj.cli.run_summary import report_metrics
    from anm_mj.evaluation.run_evaluation import completion_with_halved_intrinsics, evaluate_run
    from anm_mj.io.run_folder import RunFolder

    if not novel_views:
        refuse_idle({"--scene": scene}, "it is read for novel views alone; add --novel-views")
    # A link such as runs/latest may lead somewhere else before the last of these is done.
    run = RunFolder.open(run).path
    console = PlainConsole()
    novel, fixed = None, None
    if novel_views:
        from anm_mj.evaluation.fixed_views import evaluate_fixed_views
        from anm_mj.evaluation.novel_views import evaluate_novel_views

        with progress_bar(console, "novel views") as on_progress:
            novel = evaluate_novel_views(run, scene=scene, on_progress=on_progress)
        with progress_bar(console, "fixed views") as on_progress:
            fixed = evaluate_fixed_views(run, scene=scene, on_progress=on_progress)
    with ProgressLine(console) as line:
        metrics = evaluate_run(run, line.survey, novel, fixed)
    report = report_metrics(console, metrics, run)
    if halved_intrinsics:
        other = completion_with_halved_intrinsics(run)
        console.say(
            f"With halved intrinsics: completion ratio {other.ratio_percent:.2f} %, completion "
            f"{other.completion_cm:.2f} cm"
        )
        report.facts["with_halved_intrinsics"] = other
    return report
