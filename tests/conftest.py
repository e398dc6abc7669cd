"""What tests of several packages share."""

import importlib.util
import signal
from pathlib import Path
from types import ModuleType

import pytest

SHARED = Path(__file__).resolve().parents[2] / "shared"
"""Worlds and the scorer, beside the repository. Tests that need them skip where they are absent."""

# a shell ignores Ctrl-C for what it starts in the background, and so would all commands that tests start
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def scorer() -> ModuleType:
    """The independent scorer of run directories."""
    path = SHARED / "score" / "score_run.py"
    if not path.exists():
        pytest.skip("the scorer lies beside the repository, in shared/")
    spec = importlib.util.spec_from_file_location("score_run", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
