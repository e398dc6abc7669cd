"""`wireswarm world`: a world alone, for robots that come from elsewhere."""

from __future__ import annotations

from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Context, Exit, Option, Typer

from agent.shell.command import Certs
from deploy.commands.options import (
    ConfigFile,
    Ideal,
    Listen,
    MaxTime,
    Out,
    Range,
    RealTime,
    Robots,
    Seed,
    Set,
    Until,
    World,
    say_doubts,
    settings_of,
)
from deploy.commands.results import leave, write_results
from protocol.command import stop_on_signals, tell
from protocol.status import Status, of_run
from protocol.text import printable

if TYPE_CHECKING:
    from deploy.config import RunConfig
    from protocol.messages import Progress
    from world.config import WorldConfig

commands = Typer()

NEVER_KEPT = ("resume", "secrets", "certs")  # options of a world that no file of a run holds


@commands.command("world", epilog="Example: wireswarm world --robots 2 --listen tls/0.0.0.0:7447 --certs certs")
def world_(
    context: Context,
    world: World = None,
    robots: Robots = None,
    seed: Seed = None,
    out: Out = None,
    range_m: Range = None,
    until: Until = None,
    max_time_s: MaxTime = None,
    real_time: RealTime = None,
    ideal: Ideal = False,
    listen: Listen = None,
    connect: Annotated[
        str | None, Option(help="A Zenoh router between world and robots.", show_default="the world is the router")
    ] = None,
    secrets: Annotated[
        Path | None, Option(help="File of secrets, without which nobody gets in; made where there is none.")
    ] = None,
    certs: Certs = None,
    insecure: Annotated[
        bool | None, Option("--insecure", help="Let anybody take part who reaches the address.")
    ] = None,
    resume: Annotated[
        Path | None,
        Option(help="Go on in the directory of a run whose world was killed, with its settings.", metavar="DIR"),
    ] = None,
    settle_s: Annotated[
        float | None,
        Option(
            "--settle",
            help="Begin with the robots that are there once none has joined for so many seconds, --robots at most.",
            show_default="wait for all",
            min=0.1,
        ),
    ] = None,
    config: ConfigFile = None,
    set_: Set = None,
) -> None:
    """Run a world alone, for robots that join it from other terminals, containers or hosts."""
    from deploy import manifest
    from deploy.launch.interrupts import on_interrupt
    from deploy.launch.launcher import run_directory
    from protocol import credentials
    from protocol.errors import InputError
    from protocol.files import remove_parts
    from world.shell.inbox import WorldInbox
    from world.shell.server import serve
    from world.worldfile import load

    settings = settings_of(context) if resume is None else _resumed(context, resume)
    say_doubts(settings.spec)
    loaded = load(settings.world)
    stop_on_signals(inbox := WorldInbox())

    goes_on, is_ours = resume is not None, False

    def listening(endpoint: str) -> None:
        nonlocal is_ours
        if goes_on:  # only now is it sure
            is_ours = True
            manifest.resume(directory)
            remove_parts(directory)
        place = "listening on" if settings.server.connect is None else "robots are awaited at"
        tell(f"{place} {endpoint}\nradio: {settings.radio}")

    def begin(settings: WorldConfig) -> None:
        begun = manifest.begun(settings, loaded)
        del begun["config"]["agent"]  # each robot has its own
        manifest.begin(directory, begun)

    def has_begun() -> bool:
        """Whether there is a run, begun or taken over by this process, of whose end it tells."""
        return is_ours if goes_on else (directory / "world.yaml").exists()

    def written(ended: str) -> None:
        if has_begun():
            manifest.finish(directory, ended=ended)

    standing: dict[str, str] = {}  # how each robot does

    def progress(progress: Progress) -> None:
        standing.update(progress.clock.status)

    router = settings.server.connect is not None
    place = nullcontext((resume, list[Path]())) if resume else run_directory(out, settings.world, settings.seed)
    with place as (directory, made), credentials.of_all(settings.robot_ids, secrets, certs, world=router) as known:
        if not goes_on:
            begin(settings)
        try:
            ended = serve(
                settings,
                settings.server,
                directory,
                credentials=known,
                inbox=inbox,
                resume=goes_on,
                settle_s=settle_s,
                counted=begin,
                listening=listening,
                awaited=lambda awaited: tell(str(awaited)),
                progress=progress,
                written=written,
            )
        except Exception as error:
            if has_begun() and not isinstance(error, InputError):
                manifest.finish(directory, ended="interrupted", exit_status=Status.FAILURE, errors=[str(error)])
            raise
        finally:
            if not goes_on and not has_begun():
                manifest.withdraw(directory)
        status = of_run(ended, settings.until, standing.values())
        if has_begun():
            manifest.finish(directory, ended=ended, exit_status=status)
    tell(f"ended: {ended}; {printable(str(directory))}" if has_begun() else f"ended: {ended}")
    if status != Status.INTERRUPTED:
        with on_interrupt(partial(leave, directory, made)):
            status = write_results(directory, status=status)
    raise Exit(status)


def _resumed(context: Context, run: Path) -> RunConfig:
    """Configuration of a run that goes on; only where its world listens may be new."""
    from deploy.finish import left_by
    from protocol.configuration import ConfigError, validated
    from world.config import ServerConfig

    reach = {name: value for name in ("listen", "connect", "insecure") if (value := context.params[name])}
    unsaid: tuple[object, ...] = (None, [], ())  # False is one, too, but equals 0, a seed
    named = (name for name, value in context.params.items() if value is not False and value not in unsaid)
    given = [name for name in named if name not in (*reach, *NEVER_KEPT)]
    if given:
        option = next(one.opts[0] for one in context.command.params if one.name == given[0])
        raise ConfigError(f"--resume {run}: it goes on with the settings of its beginning, leave out {option}")
    config = left_by(run)
    server = config.server.model_dump()
    if "listen" in reach or "connect" in reach:  # what was said of the earlier address
        server |= {"listen": None, "connect": None, "insecure": False}
    return config.model_copy(update={"server": validated(ServerConfig, server | reach)})
