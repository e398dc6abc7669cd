"""Whether Python finds our own packages: their names are generic, and another of the same name may be in the way."""

from importlib.util import find_spec
from pathlib import Path

PACKAGES = ("protocol", "agent", "world", "deploy")  # our packages beside `wireswarm`
HOME = Path(__file__).resolve().parents[1]  # the folder that holds our packages: a checkout or site-packages


class ForeignPackageError(ImportError):
    """Python finds another package, or none, under the name of one of ours; one sentence that says what to do."""


def check_packages() -> None:
    """Raise ForeignPackageError where `import NAME` would not give our own package. Imports nothing."""
    for name in PACKAGES:
        spec = find_spec(name)
        places = [] if spec is None else [*(spec.submodule_search_locations or ()), spec.origin]
        found = [Path(place).resolve() for place in places if place]
        if not found:
            raise ForeignPackageError(f"its package `{name}` is missing from {HOME}: install wireswarm again")
        if found[0] != HOME / name:
            raise ForeignPackageError(
                f"another package `{name}` at {found[0]} hides wireswarm's own at {HOME / name}: rename it, leave its "
                "folder or take it off PYTHONPATH, or install wireswarm into an environment of its own"
            )
