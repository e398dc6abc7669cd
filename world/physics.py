"""Differential-drive robots as rigid discs that push against walls and each other (pymunk)."""

from __future__ import annotations

import numpy as np
import pymunk
import pymunk.batch
from numpy.typing import NDArray
from pymunk.batch import BodyFields

from protocol.messages import RobotSpec
from world.config import PhysicsConfig

_WALL, _ROBOT = 1, 2
_READ = BodyFields.BODY_ID | BodyFields.POSITION | BodyFields.ANGLE | BodyFields.VELOCITY
_READ |= BodyFields.ANGULAR_VELOCITY


class Physics:
    """The bodies of all robots among the walls; deterministic to the bit for the same calls."""

    def __init__(
        self,
        segments: NDArray[np.float64],
        poses: NDArray[np.float64],
        spec: RobotSpec,
        config: PhysicsConfig,
        period_s: float,
    ) -> None:
        """Walls (n, 4) and start poses (k, 3) in metres, world frame; one `advance` takes period_s."""
        self.poses = np.array(poses, np.float64)
        """(k, 3) where the robots are; theta grows beyond pi where they turn on and on."""
        self.wall_contacts = np.zeros(len(poses), np.int64)
        """(k,) times that a robot began to touch walls, after a whole period without."""
        self.robot_contacts = np.zeros(len(poses), np.int64)
        """(k,) the same for touching other robots."""
        self._limits = np.array([spec.max_speed_mps, spec.max_turn_rps])
        self._steps = max(1, round(period_s / config.step_s))
        self._dt = period_s / self._steps
        moment = pymunk.moment_for_circle(config.mass_kg, 0, spec.radius_m)
        self._gain = np.array([config.mass_kg, config.mass_kg, moment]) / self._dt
        self._space = space = pymunk.Space()
        space.iterations = config.iterations
        space.collision_slop = config.slop_m
        for x1, y1, x2, y2 in segments.tolist():
            wall = pymunk.Segment(space.static_body, (x1, y1), (x2, y2), 0)
            wall.collision_type = _WALL
            space.add(wall)
        self._row: dict[int, int] = {}
        for i, (x, y, theta) in enumerate(self.poses.tolist()):
            body = pymunk.Body(config.mass_kg, moment)
            body.position, body.angle = (x, y), theta
            disc = pymunk.Circle(body, spec.radius_m)
            disc.collision_type = _ROBOT
            disc.friction = 0.0  # a disc without friction gets no torque: turns are as commanded
            space.add(body, disc)
            self._row[body.id] = i
        self._touched = np.zeros((2, len(poses)), np.bool_)  # walls, robots; in this period
        self._touched_before = self._touched.copy()
        space.on_collision(_ROBOT, _WALL, pre_solve=self._touch, data=self._touched[0])
        space.on_collision(_ROBOT, _ROBOT, pre_solve=self._touch, data=self._touched[1])
        self._state, self._drive = pymunk.batch.Buffer(), pymunk.batch.Buffer()

    def advance(self, commands: NDArray[np.float64]) -> NDArray[np.float64]:
        """Drive for one period at (k, 2) speed in m/s and turn rate in rad/s, clamped to what the robot can.

        Returns the new poses, (k, 3). Raises ValueError where a command is not finite.
        """
        if not np.isfinite(commands).all():
            raise ValueError("a drive command is not finite")
        speed, turn = np.clip(commands, -self._limits, self._limits).T
        self._touched_before[:] = self._touched
        self._touched[:] = False
        if len(self.poses):
            rows = self._rows()
            speed, turn = speed[rows[:-1]], turn[rows[:-1]]
            force = np.zeros((len(rows), 3))  # the last row is the static body, which stays
            for _ in range(self._steps):
                self._step(speed, turn, force)
            self.poses = self._read()[np.argsort(rows[:-1]), :3]
        began = self._touched & ~self._touched_before
        self.wall_contacts += began[0]
        self.robot_contacts += began[1]
        return self.poses

    def _step(self, speed: NDArray[np.float64], turn: NDArray[np.float64], force: NDArray[np.float64]) -> None:
        """One physics step, driven by force.

        pymunk moves first and solves contacts after: a velocity written before each step would throw the
        solution away, and robots would sink into walls.
        """
        state, dt = self._read()[:-1], self._dt
        heading = state[:, 2] + state[:, 5] * dt + turn * (dt / 2)  # in the middle of the coming move
        force[:-1, 0] = speed * np.cos(heading)
        force[:-1, 1] = speed * np.sin(heading)
        force[:-1, 2] = turn
        force[:-1] -= state[:, 3:]
        force[:-1] *= self._gain
        self._drive.set_float_buf(force)
        pymunk.batch.set_space_bodies(self._space, BodyFields.FORCE | BodyFields.TORQUE, self._drive)
        self._space.step(dt)

    def _read(self) -> NDArray[np.float64]:
        """(k + 1, 6) x, y, angle, vx, vy, turn rate in pymunk's order; the static body is last."""
        self._state.clear()
        pymunk.batch.get_space_bodies(self._space, _READ, self._state)
        return np.frombuffer(self._state.float_buf()).reshape(-1, 6)

    def _rows(self) -> NDArray[np.intp]:
        """Which robot each of pymunk's rows is; -1 for the static body, which must be last."""
        self._read()
        ids = np.frombuffer(self._state.int_buf(), np.uintp).tolist()
        rows = np.array([self._row.get(body, -1) for body in ids], np.intp)
        if (rows[:-1] < 0).any() or rows[-1] != -1:
            raise RuntimeError("pymunk's batch no longer puts the static body last")
        return rows

    def _touch(self, arbiter: pymunk.Arbiter, space: pymunk.Space, touched: NDArray[np.bool_]) -> None:
        """Called by pymunk for each pair of shapes that touch in a step."""
        touched[[self._row[body.id] for body in arbiter.bodies if body.id in self._row]] = True
