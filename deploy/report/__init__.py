"""The report of a finished run, from the files of its run directory alone."""

from functools import partial
from pathlib import Path

from deploy.report.page import write_page
from deploy.report.picture import write_picture
from deploy.report.rundir import read_run
from protocol.files import write_all


def write_report(run_dir: Path) -> Path:
    """Write report.png and report.html into a run directory; returns the path of the page.

    Files that are missing or broken are named in the page. Raises NoDirectoryError where there is
    nothing of a run, UnwritableError for a file that cannot be written, after the other was tried.
    """
    run = read_run(run_dir)
    picture, page = (
        partial(write_picture, run, run_dir / "report.png"),
        partial(write_page, run, run_dir / "report.html"),
    )
    write_all(picture, page)
    return run_dir / "report.html"
