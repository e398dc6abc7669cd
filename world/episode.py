"""One run of the world, tick by tick: observations out, actions in. No clock, no network."""

import json
from collections.abc import Callable, Iterator, Mapping
from hashlib import blake2s
from pathlib import Path
from typing import Any, Self

import numpy as np

from protocol.arrays import Floats
from protocol.checksum import UNREADABLE
from protocol.messages import PROTOCOL_VERSION, Action, LinkTable, Observation, Welcome
from protocol.wireframe import Wireframe
from world.checkpoint import CHECKPOINT_FILE, Checkpoint, CheckpointError, State, restore_rng, rng_state
from world.config import WorldConfig
from world.draws import generator, starts_of
from world.ledger import Ledger, Look
from world.lidar.lidar import Lidar
from world.odometry import Odometry
from world.people import People
from world.physics import Physics
from world.radio.gate import Radio
from world.recorder import REPLACED, seconds
from world.tick import Inputs, Outputs, checked_map
from world.way import interpolated
from world.worldfile import World, load

CHECKPOINT_S = 5.0
"""Simulated time between two checkpoints at most. What follows one is told again after a kill, at the world's speed."""


class Episode:
    """The truth of one run. Deterministic: the same config and the same answers give the same bytes."""

    def __init__(
        self, config: WorldConfig, out: Path | None, state: State | None = None, *, run: str | None = None
    ) -> None:
        """`out` is the run directory, None to record nothing. state: to go on from (see `resume`), None to begin.

        run: 16 hexadecimal digits by which robots know this run; None: those that follow from its settings.
        Raises WorldFileError for a world that cannot be run, OSError where `out` cannot be written.
        """
        spec = config.spec
        self.config = config
        self.world = load(config.world)
        self.robots = config.robot_ids
        self._settings = _settings_of(config, self.world)
        self._run = run or self._settings[:16]
        self.tick = 0
        self.period_s = 1 / spec.lidar.rate_hz
        self.ended: str | None = None
        """None while the run goes on; "complete", "time", "dead" (nobody is left), or "interrupted"."""
        self.late_ticks = 0
        """Ticks that robots missed in real time; counted by the shell."""
        self.links_lost = 0
        """How often a robot's link was lost; counted by the shell."""
        self.wall_s: float | None = None
        """Seconds that the run took; set by the shell before `close`, because the core has no clock."""
        self.wire: dict[str, Any] | None = None
        """Bytes on the robots' links for bandwidth.json; set by the shell before `close`."""
        self.actions: dict[str, Action] = {}
        """Each robot's last action: what it had merged, whether it was complete, and how it drove."""
        self.processes: dict[str, str] = {}
        """By which the shell knows the process of each robot that has joined; see `arrive`."""
        self.dead: dict[str, str] = {}
        """The reason for each robot that died."""

        self.starts = starts_of(config, self.world)
        """(k, 3) world poses at tick 0: the robots' own frames."""
        self._rows = {robot: i for i, robot in enumerate(self.robots)}
        self._physics = Physics(self.world.segments, self.starts, spec, self.period_s)
        self._lidar = Lidar(self.world.segments, spec.lidar, one_sided=True)
        self._lidar_noise = [generator(config.seed, "lidar", robot) for robot in self.robots]
        self._wheels_read = np.arange(1, spec.poses_per_scan + 1) / spec.poses_per_scan
        """(n,) when the wheels are read, as shares of a period."""
        self._odometry = [
            Odometry(start, spec.odometry, generator(config.seed, "odometry", robot))
            for robot, start in zip(self.robots, self.starts, strict=True)
        ]
        rng = generator(config.seed, "people")
        self._people = People(config.people, self.world, self.starts, spec.radius_m, self.period_s, rng)
        self._radio = Radio(self.robots, config.radio, config.seed, self.period_s, self.world.segments)
        books, past = self._radio.books, state and state["ledger"]
        self._ledger = Ledger(config, self.world, self.robots, self.starts, books, out, past)
        self._inputs: dict[str, Inputs] | None = None
        self._unbooked: Look | None = None
        self._answered: list[tuple[int, str, Outputs, Wireframe | None]] = []
        """Tick, robot, answer and its map, where the ledger was not told yet."""
        self._closed = False
        self.goes_on = state is not None
        """Whether another process has begun the run."""
        self._resumed_s = 0.0
        """Simulated seconds at which this process took the run over."""
        self._checkpoint: Checkpoint | None = None
        self._checkpoint_tick = 0
        if state is not None:
            self._restore(state)
        elif out is not None:
            self._checkpoint = Checkpoint(out)
            self._checkpoint.begin(self.state())

    @classmethod
    def resume(cls, config: WorldConfig, out: Path) -> Self:
        """The episode that a killed process left in a run directory, at the tick at which it was left.

        Raises CheckpointError where there is none, or a file is damaged; OSError where `out` cannot be written.
        """
        checkpoint = Checkpoint(out)
        state, log = checkpoint.read()
        if state.get("settings") != _settings_of(config, load(config.world)):
            raise CheckpointError(
                f"{out / CHECKPOINT_FILE} is of a run with other settings or another world than {out} tells"
            )
        try:
            episode = cls(config, out, state)
            for name, looked, arguments in log:
                episode._tell(name, looked, arguments)
        except CheckpointError:
            raise
        except UNREADABLE as error:
            raise checkpoint.broken(error) from error
        checkpoint.go_on()
        episode._checkpoint, episode._resumed_s = checkpoint, episode.t
        return episode

    def _tell(self, name: str, looked: bool, arguments: list[Any]) -> None:
        """Do again what the log says."""
        if looked:
            self.inputs()
        match name, arguments:
            case "advance", [answers]:
                self.advance({robot: Outputs.restored(*answer) for robot, answer in answers.items()})
            case "kill", [robot, reason]:
                self.kill(robot, reason)
            case "arrive", [robot, process]:
                self.arrive(robot, process)
            case "happened", [robot, event, reason]:
                self.happened(robot, event, reason)
            case _:
                raise ValueError(f"the log says {name!r}")

    def _log(self, name: str, *arguments: Any) -> None:
        if self._checkpoint is not None:
            self._checkpoint.add((name, self._inputs is not None, list(arguments)))

    def state(self) -> State:
        """For a checkpoint, before this tick was looked at."""
        assert self._inputs is None
        self.book()
        return {
            "settings": self._settings,
            "run": self._run,
            "tick": self.tick,
            "actions": {robot: action.model_dump(exclude={"events"}) for robot, action in self.actions.items()},
            "processes": self.processes,
            "dead": self.dead,
            "late_ticks": self.late_ticks,
            "links_lost": self.links_lost,
            "physics": self._physics.state(),
            "people": self._people.state(),
            "lidar_noise": [rng_state(rng) for rng in self._lidar_noise],
            "odometry": [odometry.state() for odometry in self._odometry],
            "radio": self._radio.state(),
            "ledger": self._ledger.state(),
        }

    def _restore(self, state: State) -> None:
        self.tick, self._run = int(state["tick"]), str(state["run"])
        self.late_ticks, self.links_lost = int(state["late_ticks"]), int(state["links_lost"])
        self._checkpoint_tick = self.tick
        for robot, action in state["actions"].items():
            self.actions[robot] = Action.model_validate(action)
        self.processes.update(state["processes"])
        self.dead.update(state["dead"])
        self._physics.restore(state["physics"])
        self._people.restore(state["people"])
        self._radio.restore(state["radio"])
        for rng, kept in zip(self._lidar_noise, state["lidar_noise"], strict=True):
            restore_rng(rng, kept)
        for odometry, path in zip(self._odometry, state["odometry"], strict=True):
            odometry.restore(path)

    @property
    def t(self) -> float:
        """Simulated seconds at this tick."""
        return seconds(self.tick * self.period_s)

    @property
    def live(self) -> list[str]:
        """Robots that are not dead."""
        return [robot for robot in self.robots if robot not in self.dead]

    @property
    def complete(self) -> dict[str, bool]:
        """Whether each robot's last action said that it is complete."""
        return {robot: robot in self.actions and self.actions[robot].complete for robot in self.robots}

    @property
    def absent(self) -> list[str]:
        """Robots that have not joined yet; none where no shell tells of processes."""
        return [robot for robot in self.robots if self.processes and robot not in self.processes]

    @property
    def poses(self) -> Floats:
        """(k, 3) true poses at this tick."""
        return self._physics.poses

    @property
    def coverage(self) -> dict[str, float]:
        """Share of the visible wall that each robot has covered, by own beams or merged maps."""
        self.book()
        return dict(zip(self.robots, self._ledger.coverage.covered.tolist(), strict=True))

    @property
    def paths(self) -> dict[str, float]:
        """Metres that each robot has driven."""
        return dict(zip(self.robots, self._ledger.path_m.tolist(), strict=True))

    @property
    def team_coverage(self) -> float:
        """Share of the visible wall that the beams of any robot have hit."""
        self.book()
        return self._ledger.coverage.team

    @property
    def links(self) -> LinkTable:
        """Who hears whom, for anybody."""
        return self._radio.table(self.tick)

    def welcome(self, robot: str, *, lockstep: bool = True) -> Welcome:
        """What a robot must know of its body, clock and seed."""
        radio = self.config.radio
        limits = {"radio_range_m": radio.range_m, "radio_mtu_bytes": radio.mtu_bytes}
        spec = self.config.spec.model_copy(update=limits)
        seed = int(generator(self.config.seed, "mind", robot).integers(2**63))
        return Welcome(
            version=PROTOCOL_VERSION,
            robot=robot,
            spec=spec,
            seed=seed,
            lockstep=lockstep,
            run=self._run,
            tick=self.tick,
        )

    def inputs(self) -> dict[str, Inputs]:
        """What each live robot hears and sees at this tick; the same on every call."""
        return dict(self.hand_out())

    def hand_out(self) -> Iterator[tuple[str, Inputs]]:
        """The same robot by robot as it is made, so that the first ones think while others wait. It is for one use."""
        if self._inputs is None:
            yield from self._look()
        else:
            yield from ((robot, inputs) for robot, inputs in self._inputs.items() if robot not in self.dead)

    def _look(self) -> Iterator[tuple[str, Inputs]]:
        """Deliver messages and cast the scans of this tick."""
        live, absent = self.live, self.absent
        heard, passages = self._radio.deliver(self.tick, live, absent)
        rows = np.array([self._rows[robot] for robot in live], np.intp)
        way = self._physics.way if self.config.spec.lidar.turning else self._physics.way[-1:]
        bodies = way.copy()
        bodies[..., 2] = self.config.spec.radius_m
        ranges, met = self._lidar.trace(way[:, rows], np.concatenate([bodies, self._people.bodies(len(way))], 1))
        rays, rngs = self._lidar.rays(way[:, rows]), [self._lidar_noise[row] for row in rows]
        measured = (self._lidar.measured(ranges, rngs, met, rays) if rngs else ranges).astype("<f4")
        met[~np.isfinite(measured)] = -1  # a beam that returned nothing covers nothing
        met[[robot in absent for robot in live]] = -1  # nor does the scan of a robot that nobody is there to read
        ways, slipping = interpolated(self._physics.way, self._wheels_read), self._physics.touching
        turned = self._physics.driven * (self.period_s / len(ways))
        inputs = {}
        for robot, row, scan in zip(live, rows.tolist(), measured, strict=True):
            told = self._odometry[row].update(ways[:, row], turned[row] if slipping[row] else None)
            inputs[robot] = made = Inputs(
                heard[robot],
                Observation(
                    tick=self.tick,
                    ranges=scan.tobytes(),
                    odometry=self._odometry[row].pose,
                    way=told.astype("<f8").tobytes(),
                    heard=len(heard[robot]),
                ),
            )
            yield robot, made
        odometry = np.array([self._odometry[row].pose for row in rows]).reshape(-1, 3)
        self._unbooked = Look(rows, rays, ranges, met, measured, odometry, passages)
        self._inputs = inputs

    def book(self) -> None:
        """Account for the last tick's answers and for what this tick showed.

        A shell calls it while robots think, who would wait for it else. Whoever asks or adds to the ledger calls it.
        """
        answered, self._answered = self._answered, []
        for tick, robot, answer, wireframe in answered:
            self._ledger.answer(tick, robot, answer, wireframe)
        look, self._unbooked = self._unbooked, None
        if look is not None:
            self._ledger.look(self.tick, look, self.poses)

    def advance(self, outputs: Mapping[str, Outputs]) -> None:
        """Take the answers of all live robots to this tick, and drive to the next.

        Raises BadOutputsError, a ProtocolError that names the robot, before anything has changed; KeyError
        where a live robot's answer is missing.
        """
        live = self.live
        maps = {robot: checked_map(robot, outputs[robot], self.tick, self._rows, self._radio) for robot in live}
        self._log("advance", {robot: outputs[robot].state() for robot in live})
        self.inputs()  # a shell that did not ask for them gets the same world
        self.book()
        commands = np.zeros((len(self.robots), 2))
        for robot in live:
            action = self.actions[robot] = outputs[robot].action
            commands[self._rows[robot]] = action.speed_mps, action.turn_rps
            self._answered.append((self.tick, robot, outputs[robot], maps[robot]))
        self._radio.offer(self.tick, {robot: outputs[robot].sends for robot in live}, self.poses[:, :2])
        self._people.advance(self.poses[:, :2])
        self._physics.advance(commands)
        self._ledger.drive(self._physics.way)
        self.tick, self._inputs = self.tick + 1, None
        self.ended = self.ended or self._end()
        self._record()

    def _record(self) -> None:
        """Begin the checkpoint anew where that is due."""
        if self._checkpoint is None or self.ended:
            return
        since_s = (self.tick - self._checkpoint_tick) * self.period_s
        if since_s > CHECKPOINT_S - 1e-6 or self._checkpoint.is_long:
            self._checkpoint.begin(self.state())
            self._checkpoint_tick = self.tick

    def _end(self) -> str | None:
        until = self.config.until
        if not self.live:
            return "dead"
        if until == "complete" and all(self.actions[robot].complete for robot in self.live):
            return "complete"
        limit = self.config.max_time_s if until == "complete" else min(until, self.config.max_time_s)
        return "time" if self.t >= limit - 1e-6 else None

    def kill(self, robot: str, reason: str) -> None:
        """Count a robot as dead: it stands where it is, hears and says nothing more; the others go on."""
        if robot in self.dead:
            return
        self._log("kill", robot, reason)
        self.dead[robot] = reason
        self.book()
        self._ledger.happened(self.tick, robot, "dead", reason)
        if not self.live and self.ended is None:
            self.ended = "dead"

    def arrive(self, robot: str, process: str) -> None:
        """Keep in mind that a process is this robot's, for a shell that goes on after a kill."""
        self._log("arrive", robot, process)
        self.processes[robot] = process

    def came_back(self, robot: str) -> None:
        """Log that a robot's process ended, and that another took its place at this tick."""
        self.happened(robot, "left", "its process ended")
        self.happened(robot, "rejoined", REPLACED)

    def happened(self, robot: str, event: str, reason: str) -> None:
        """Log what happened to a robot's process at this tick: it left, joined or came back."""
        self._log("happened", robot, event, reason)
        self.book()
        self._ledger.happened(self.tick, robot, event, reason)

    def close(self, written: Callable[[str], None] = lambda ended: None) -> None:
        """Write what is left of the run directory. A run that did not end by itself was interrupted.

        `written` is told how it ended, once all is written: from then on nobody needs the checkpoint, which goes.
        Raises UnwritableError, and what `written` raises; the checkpoint stays.
        """
        if self._closed:
            return
        self._closed = True
        self.book()
        self._ledger.settle(self.tick)
        self.ended = self.ended or "interrupted"
        _, passages = self._radio.deliver(self.tick, self.live, ended=True)
        moved_to = self.poses if self._inputs is None else None
        self._ledger.close(self.tick, passages, moved_to, self.summary(), self.wire)
        written(self.ended)
        if self._checkpoint is not None:
            self._checkpoint.remove()

    def summary(self) -> dict[str, Any]:
        """The fields of summary.json."""
        self.book()
        how = {robot: "complete" if done else self.ended or "interrupted" for robot, done in self.complete.items()}
        how |= dict.fromkeys(self.dead, "dead")
        figures = self._ledger.robot_figures(self._physics)
        return {
            "robots": {robot: fields | {"ended": how[robot]} for robot, fields in figures.items()},
            "team": self._ledger.team_figures(),
            "real_time_factor": round((self.t - self._resumed_s) / self.wall_s, 2) if self.wall_s else None,
            "late_ticks": self.late_ticks,
            "links_lost": self.links_lost,
        }


def _settings_of(config: WorldConfig, world: World) -> str:
    """Digest of all that a run's results follow from, but for the robots' minds: 32 hexadecimal digits."""
    told = config.model_dump(mode="json", include=WorldConfig.model_fields.keys() - {"world"})
    return blake2s(f"{json.dumps(told, sort_keys=True)} {world.hash}".encode(), digest_size=16).hexdigest()
