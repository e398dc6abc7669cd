"""A mind that is carried: it maps what its lidar sees, and somebody else drives, as in a recorded log."""

from agent.config import AgentConfig
from agent.mapping.submap_wireframe import wireframe_of
from agent.mapping.submaps import Submaps
from agent.mapping.wheels import way_from
from agent.perception.perceive import Perception
from protocol.arrays import Floats
from protocol.geometry import Pose, compose, pose_of, relative
from protocol.messages import Observation, RobotSpec
from protocol.wireframe import Wireframe


class Passenger:
    """Perception and mapping of a robot without its driving and without peers."""

    def __init__(self, spec: RobotSpec, config: AgentConfig) -> None:
        """The pose at the first observation is the origin of its frame."""
        self.perception = Perception(config.perception, spec, alone=True)
        self.submaps = Submaps(config.filter.submaps, spec.lidar.half_view())
        self._odometry: Pose | None = None

    def step(self, observation: Observation) -> None:
        """Take one scan. Its odometry may have any error; the steps between scans may be of any length.

        Its way, where there is one, leads from the begin of the lidar's turn to its end, however long ago the last was.
        """
        before = observation.odometry if self._odometry is None else self._odometry
        self._odometry = observation.odometry
        poses = observation.poses()
        begin, since = (pose_of(poses[0]), poses[1:]) if observation.way else (before, poses)
        start = compose(self.submaps.pose, relative(before, begin))
        scan = self.perception.see(observation, way_from(begin, since), start, Wireframe())
        self.submaps.take(scan, relative(before, observation.odometry))

    def finish(self) -> None:
        """After the last scan: look for the loops of the last way, and settle all once more."""
        self.submaps.finish()

    def wireframe(self) -> Wireframe:
        """The map, in the own frame."""
        return wireframe_of(self.submaps.walls())

    def path(self) -> Floats:
        """(scans, 3) pose at each scan by what is known now, in the own frame."""
        return self.submaps.path()
