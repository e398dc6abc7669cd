"""Differential-drive robots as rigid discs that push against walls and each other (pymunk)."""

import math
from typing import Any

import numpy as np
import pymunk
import pymunk.batch
from numpy.typing import NDArray
from pymunk.batch import BodyFields

from protocol.arrays import Bools, Floats, Ints
from protocol.messages import RobotSpec
from world.checkpoint import State, restore_array

STEP_S = 0.02
"""Time of one physics step: at 0.22 m/s a robot moves 4 mm in it."""
STEP_RADII = 0.5
"""Radii that a robot drives in one step at most: with 3 it was beyond a wall before it touched it."""
ITERATIONS = 10
"""Rounds of the contact solver in each step, measured to be enough; pymunk's default."""
SLOP_M = 1e-3
"""Bodies may sink into each other by this much at rest; pymunk's default of 0.1 is meant for pixels."""
MASS_KG = 1.0
"""Mass of a TurtleBot3 Burger; it decides only who pushes whom."""
RENEWED_S = 5.0
"""Simulated time after which the bodies of every run go on in a new space, which knows nothing but them.

pymunk hides impulses of bodies that touch, and solves contacts in an order that follows from the past of its search
tree. So a state is how the space began, and what robots drove since; else a killed world would go on differently.
"""

_WALL, _ROBOT = 1, 2
_READ = BodyFields.BODY_ID | BodyFields.POSITION | BodyFields.ANGLE | BodyFields.VELOCITY
_READ |= BodyFields.ANGULAR_VELOCITY
_WRITE = BodyFields.FORCE | BodyFields.TORQUE


class Physics:
    """The bodies of all robots among the walls. The same calls give the same bits."""

    def __init__(self, segments: Floats, poses: Floats, spec: RobotSpec, period_s: float) -> None:
        """Walls (n, 4) and start poses (k, 3) in metres, world frame; one `advance` takes period_s."""
        leaps = math.ceil(spec.max_speed_mps * period_s / (STEP_RADII * spec.radius_m))
        self._steps = max(1, round(period_s / STEP_S), leaps)
        self.way = np.repeat(np.array(poses, np.float64)[None], self._steps + 1, 0)
        """(s, k, 3) poses at the begin of the last period and after each of its steps (`world.way`)."""
        self._contacts = np.zeros((2, len(poses)), np.int64)
        self.wall_contacts, self.robot_contacts = self._contacts
        """(k,) how often each robot began to touch a wall, or another robot, after a whole period without touch."""
        self._limits = np.array([spec.max_speed_mps, spec.max_turn_rps])
        self._dt = period_s / self._steps
        moment = pymunk.moment_for_circle(MASS_KG, 0, spec.radius_m)
        self._moment, self._radius_m, self._segments = moment, spec.radius_m, segments
        self._gain = np.array([MASS_KG, MASS_KG, moment]) / self._dt
        self._touched = np.zeros((2, len(poses)), np.bool_)  # walls, robots; in this period
        self.driven = np.zeros((len(poses), 2))
        """(k, 2) speed in m/s and turn rate in rad/s at which the motors turned the wheels in the last period."""
        self._state_buffer, self._force_buffer = pymunk.batch.Buffer(), pymunk.batch.Buffer()
        self._periods = max(1, round(RENEWED_S / period_s))
        self._renew(np.hstack([self.poses, np.zeros((len(poses), 3))]))

    def _renew(self, bodies: Floats) -> None:
        """Go on in a new space with the bodies of all robots: (k, 6) x, y, angle, vx, vy, turn rate."""
        self._renewed: State = {"bodies": bodies.tobytes()} | {name: a.tobytes() for name, a in self._parts().items()}
        self._since: list[Floats] = []
        """What was `driven` since."""
        self._space = space = pymunk.Space()
        space.iterations = ITERATIONS
        space.collision_slop = SLOP_M
        for x1, y1, x2, y2 in self._segments.tolist():
            wall = pymunk.Segment(space.static_body, (x1, y1), (x2, y2), 0)
            wall.collision_type = _WALL
            space.add(wall)
        self._row: dict[int, int] = {}
        for i, (x, y, theta, vx, vy, spin) in enumerate(bodies.tolist()):
            body = pymunk.Body(MASS_KG, self._moment)
            body.position, body.angle, body.velocity, body.angular_velocity = (x, y), theta, (vx, vy), spin
            disc = pymunk.Circle(body, self._radius_m)
            disc.collision_type = _ROBOT
            disc.friction = 0.0  # a disc without friction gets no torque: turns are as commanded
            space.add(body, disc)
            self._row[body.id] = i
        space.on_collision(_ROBOT, _WALL, pre_solve=self._touch, data=self._touched[0])
        space.on_collision(_ROBOT, _ROBOT, pre_solve=self._touch, data=self._touched[1])
        self._state = self._read()
        self._rows = self._robots_of_rows()

    def advance(self, commands: Floats) -> Floats:
        """Drive for one period at (k, 2) speed in m/s and turn rate in rad/s, clamped to what the robot can.

        Returns the new poses, (k, 3). Raises ValueError where a command is not finite.
        """
        if not np.isfinite(commands).all():
            raise ValueError("a drive command is not finite")
        touched_before = self._touched.copy()
        self._touched[:] = False
        if len(self.poses):
            if not np.array_equal(self._rows, self._robots_of_rows()):
                raise RuntimeError("pymunk's batch changed the order of its bodies")
            self.driven = np.clip(commands, -self._limits, self._limits)
            self._drive(*self.driven[self._rows].T)
        self._contacts += self._touched & ~touched_before
        self._since.append(self.driven)
        if len(self._since) == self._periods:
            self._renew(self._state[np.argsort(self._rows)])
        return self.poses

    @property
    def poses(self) -> Floats:
        """(k, 3) x, y, theta of the robots, world frame; theta is not wrapped."""
        return np.asarray(self.way[-1], np.float64)

    @property
    def touching(self) -> Bools:
        """(k,) which robots touched something in the last period."""
        return np.asarray(self._touched.any(0))

    def state(self) -> State:
        """For a checkpoint: how the last new space began, and what robots drove since."""
        return {**self._renewed, "since": [driven.tobytes() for driven in self._since]}

    def restore(self, state: State) -> None:
        """Go on from a state, to the same bits. Raises ValueError where it is none of a world with these robots."""
        bodies = np.zeros((len(self.poses), 6))
        restore_array(bodies, state["bodies"])
        for name, part in self._parts().items():
            restore_array(part, state[name])
        if not np.array_equal(self.poses, bodies[:, :3]):
            raise ValueError("the way does not end where the bodies are")
        self._renew(bodies)
        for data in state["since"]:
            commands = np.zeros_like(self.driven)
            restore_array(commands, data)
            self.advance(commands)

    def _parts(self) -> dict[str, NDArray[Any]]:
        return {"way": self.way, "driven": self.driven, "contacts": self._contacts, "touched": self._touched}

    def _drive(self, speed: Floats, turn: Floats) -> None:
        """All physics steps of one period, at (k,) speeds and turn rates in pymunk's order.

        Bodies are driven by force. pymunk moves first and solves contacts after, so a velocity written before each
        step would throw the solution away, and robots would sink into walls.
        """
        dt, half_turn = self._dt, turn * (self._dt / 2)
        force = np.zeros((len(speed) + 1, 3))  # the last row is the static body, which stays
        wanted = force[:-1]
        way = np.empty_like(self.way)
        way[0] = self.poses
        for step in range(self._steps):
            state = self._state[:-1]
            heading = state[:, 2] + state[:, 5] * dt + half_turn  # in the middle of the coming move
            np.multiply(speed, np.cos(heading), out=wanted[:, 0])
            np.multiply(speed, np.sin(heading), out=wanted[:, 1])
            wanted[:, 2] = turn
            wanted -= state[:, 3:]
            wanted *= self._gain
            self._force_buffer.set_float_buf(force)
            pymunk.batch.set_space_bodies(self._space, _WRITE, self._force_buffer)
            self._space.step(dt)
            self._state = self._read()
            way[step + 1, self._rows] = self._state[:-1, :3]
        self.way = way

    def _read(self) -> Floats:
        """(k + 1, 6) x, y, angle, vx, vy, turn rate in pymunk's order, the static body last, until the next read."""
        self._state_buffer.clear()
        pymunk.batch.get_space_bodies(self._space, _READ, self._state_buffer)
        return np.frombuffer(self._state_buffer.float_buf()).reshape(-1, 6)

    def _robots_of_rows(self) -> Ints:
        """(k,) the robot in each row of the last read but the static body's, which must be the last row."""
        ids = np.frombuffer(self._state_buffer.int_buf(), np.uintp).tolist()
        rows = np.array([self._row.get(body, -1) for body in ids], np.intp)
        if (rows[:-1] < 0).any() or rows[-1] != -1:
            raise RuntimeError("pymunk's batch no longer puts the static body last")
        return rows[:-1]

    def _touch(self, arbiter: pymunk.Arbiter, space: pymunk.Space, touched: Bools) -> None:
        """Called by pymunk for each pair of shapes that touch in a step."""
        touched[[self._row[body.id] for body in arbiter.bodies if body.id in self._row]] = True
