"""Where numba keeps compiled kernels: a folder for each state of the sources.

Numba looks at the file of a kernel alone, and would go on using one whose callee in another file has changed.
"""

from __future__ import annotations

import hashlib
import os
import shutil
from pathlib import Path


def use_own_cache() -> None:
    """Point numba to a cache that fits these sources; before numba is imported, and only where nobody else did."""
    here = Path(__file__).parent
    if "NUMBA_CACHE_DIR" in os.environ or not os.access(here, os.W_OK):
        return
    digest = hashlib.sha256()
    for source in sorted(here.glob("**/*.py")):
        digest.update(source.read_bytes())
    cache = here / "__pycache__" / f"kernels-{digest.hexdigest()[:16]}"
    if not cache.is_dir():
        for stale in cache.parent.glob("kernels-*"):
            shutil.rmtree(stale, ignore_errors=True)
        cache.mkdir(parents=True, exist_ok=True)
    os.environ["NUMBA_CACHE_DIR"] = str(cache)
