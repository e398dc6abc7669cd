"""Run directories that a killed world left: their configuration, and their end."""

from pathlib import Path

from deploy import manifest
from deploy.bandwidth.replay import config_of
from deploy.config import RunConfig
from deploy.view.invitation import withdraw
from protocol.checksum import UNREADABLE
from protocol.files import remove_parts
from world.checkpoint import CHECKPOINT_FILE, CheckpointError
from world.episode import Episode
from world.worldfile import load


def left_by(run: Path) -> RunConfig:
    """Configuration with which an episode goes on in a run directory.

    Raises NoRunError where it is none, CheckpointError where its world file is not the one that was run.
    """
    config = config_of(run)
    kept = run / "world.yaml"
    if load(str(kept)).hash != manifest.read(run).get("world_hash"):
        raise CheckpointError(f"{kept} is not the world that was run")
    return config.model_copy(update={"world": str(kept)})


def finish(run: Path) -> bool:
    """Write what a killed world did not: summary, maps, books and the last lines. Whether there was anything to do.

    Raises NoRunError and CheckpointError where the directory does not tell enough, OSError where it cannot be written.
    """
    left = (run / CHECKPOINT_FILE).exists()
    if not left and manifest.ended(run) and not manifest.is_of_logs(run):
        return False
    config = left_by(run)
    episode = Episode.resume(config, run) if left else None
    remove_parts(run)
    withdraw(run)
    if episode is None:
        manifest.finish(run, ended="interrupted")
        return True
    try:
        episode.close(lambda ended: manifest.finish(run, ended=ended))
    except UNREADABLE as error:
        raise CheckpointError(f"{run / CHECKPOINT_FILE} is damaged ({type(error).__name__})") from error
    return True
