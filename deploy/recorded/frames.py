"""Where frames lie in each other over time, as tf tells it (wiki.ros.org/tf, "Overview/Transformations")."""

from array import array
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agent.shell.ros2.laser_scan import LEVEL
from deploy.recorded.jumps import are_jumps
from deploy.recorded.lidar_log import gap_of
from protocol.arrays import Floats
from protocol.errors import InputError
from protocol.geometry import rotations

MAX_SAMPLES = 5_000_000  # of all links together, 360 MB: a robot's ten links at 50 Hz for three hours
RESET_S, RESET_SAMPLES = 1.0, 10  # a clock that goes back by more, for so many in a row, was set back
WIDTH = 9  # numbers of a sample


class Placed(NamedTuple):
    """Where a frame lies in another one at n moments."""

    poses: Floats  # (n, 3) m, m, rad: its origin and its x axis, seen from above
    apart_s: Floats  # (n,) from each moment to the nearest one at which all was told
    rarest: NDArray[np.str_]  # (n,) what was told at no nearer one
    upside_down: bool  # whether its z axis points down


class _Link:
    """A frame in its parent frame: one pose for ever, or one now and then."""

    def __init__(self, parent: str, static: bool, topic: str) -> None:
        self.parent, self.static, self.topic = parent, static, topic
        self.samples = array("d")  # s; m, m, m; quaternion x, y, z, w; s of its arrival; one after the other
        self.others = set[str]()  # topics that tell something else
        self._sound, self._sound_of = np.zeros((0, WIDTH)), 0  # what `sound` told last, and of how many numbers
        self._gap_s = 0.0  # of these, as of `gap_of`

    @property
    def rows(self) -> Floats:
        """(n, WIDTH) the samples."""
        return np.frombuffer(self.samples, np.float64).reshape(-1, WIDTH)

    @property
    def stands(self) -> bool:
        """Whether it tells one pose for ever, or the same one again and again."""
        poses = self.rows[:, 1:-1]
        return self.static or np.allclose(poses, poses[-1])

    def tells(self, parent: str, pose: Sequence[float]) -> bool:
        """Whether it tells this parent and pose for ever."""
        return self.static and parent == self.parent and np.allclose(self.rows[-1, 1:-1], pose)

    def reset_s(self) -> float | None:
        """When its clock was set back, by arrival; None where it was not. One stamp that is ahead sets nothing back."""
        times = self.rows[:, 0]
        if self.static or len(times) < RESET_SAMPLES + 2:
            return None
        before = np.fmax.accumulate(np.fmin(times[:-1], times[1:]))[:-1]  # the latest that two in a row have reached
        late, behind = times[2:] < before - RESET_S, times[2:] < before
        in_row = np.convolve(behind, np.ones(RESET_SAMPLES, np.int64), "valid") == RESET_SAMPLES
        at = np.flatnonzero(late[: len(in_row)] & in_row)
        return float(self.rows[at[0] + 2, -1]) if len(at) else None

    def sound(self) -> Floats:
        """(m, WIDTH) the samples in the order of their times, without single ones that contradict those around them."""
        if self._sound_of != len(self.samples):  # a million of them take half a second
            self._gap_s = gap_of(np.abs(np.diff(self.rows[:, 0])))
            rows = self.rows[np.argsort(self.rows[:, 0], kind="stable")]
            alone = np.zeros(len(rows) + 2, np.bool_)  # with one before the first and one behind the last
            jumps = self._are_jumps(rows[:-1], rows[1:])
            twice = 1 + np.flatnonzero(jumps[:-1] & jumps[1:])
            alone[twice + 1] = ~self._are_jumps(rows[twice - 1], rows[twice + 1])
            # where two ways alternate, none is the right one
            self._sound, self._sound_of = rows[~alone[1:-1] | alone[:-2] | alone[2:]], len(self.samples)
        return self._sound

    def _are_jumps(self, a: Floats, b: Floats) -> NDArray[np.bool_]:
        """(n,) which ways between samples (n, WIDTH), told without their arrival or with it, are jumps."""
        return are_jumps(_from_above(a), _from_above(b), b[:, 0] - a[:, 0], self._gap_s)

    def at(self, times: Floats) -> tuple[Floats, Floats, Floats]:
        """Rotations (n, 3, 3) and places (n, 3) at times (n,), between the neighbours there; and apart_s (n,).

        Where a place jumps from one neighbour to the other, it is that of the nearer one.
        """
        if self.static:
            turn, place = rotations(self.rows[-1:, 4:-1]), self.rows[-1:, 1:4]
            return np.repeat(turn, len(times), 0), np.repeat(place, len(times), 0), np.zeros(len(times))
        rows = self.sound()[:, :-1]
        after = np.clip(np.searchsorted(rows[:, 0], times), 1, max(len(rows) - 1, 1))
        a, b = rows[after - 1], rows[np.minimum(after, len(rows) - 1)]
        share = np.clip((times - a[:, 0]) / np.maximum(b[:, 0] - a[:, 0], 1e-9), 0.0, 1.0)
        share = np.where(self._are_jumps(a, b), np.round(share), share)[:, None]
        near = np.where((a[:, 4:] * b[:, 4:]).sum(1, keepdims=True) < 0, -b[:, 4:], b[:, 4:])
        apart = np.minimum(np.abs(times - a[:, 0]), np.abs(times - b[:, 0]))
        return (rotations((1 - share) * a[:, 4:] + share * near), (1 - share) * a[:, 1:4] + share * b[:, 1:4], apart)


class Frames:
    """A tree of frames. Names are told with or without a slash before them."""

    def __init__(self) -> None:
        self._links: dict[str, _Link] = {}
        self._count = 0

    def add(
        self,
        parent: str,
        child: str,
        time_s: float,
        pose: Sequence[float],
        *,
        static: bool = False,
        topic: str = "",
        arrived_s: float = 0.0,
    ) -> None:
        """Learn where a child lies in its parent: x, y, z and a quaternion x, y, z, w. Raises InputError for too many.

        A frame has one parent and one topic that tells of it: what is told of another parent, or by another topic, is
        left out.
        """
        parent, child = parent.lstrip("/"), child.lstrip("/")
        link = self._links.setdefault(child, _Link(parent, static, topic))
        if parent != link.parent or topic != link.topic:
            if topic != link.topic and not link.tells(parent, pose):
                link.others.add(topic)
            return
        self._count += 1
        if self._count > MAX_SAMPLES:
            raise InputError(f"more than {MAX_SAMPLES} transforms; split it")
        link.samples.extend((time_s, *pose, arrived_s))

    def hang(self, child: str, parent: str, pose: Sequence[float] = (0, 0, 0, 0, 0, 0, 1)) -> None:
        """Put a frame into another one for ever, whatever was told of it."""
        self._links.pop(child.lstrip("/"), None)
        self.add(parent, child, 0.0, pose, static=True)

    def take(self, others: "Frames") -> None:
        """Have the links of others in place of the own ones of the same frames."""
        self._links |= others._links

    def above(self, frame: str) -> Iterator[tuple[str, bool]]:
        """The frames in which one hangs, nearest first, each with whether all between is fixed for ever."""
        at, fixed, seen = frame.lstrip("/"), True, set[str]()
        while at in self._links and at not in seen:
            seen.add(at)
            fixed &= self._links[at].static
            at = self._links[at].parent
            yield at, fixed

    def reset_s(self, frame: str, root: str) -> float | None:
        """When the first clock between two frames was set back, by arrival; None where none was."""
        resets = [link.reset_s() for _, link in self._between(frame, root)]
        return min((reset for reset in resets if reset is not None), default=None)

    def end(self, arrived_s: float) -> None:
        """Forget what arrived at a moment or later, of all that moves."""
        for frame, link in [*self._links.items()]:
            if not link.static:
                link.samples = array("d", link.rows[link.rows[:, -1] < arrived_s].tobytes())
                if not link.samples:
                    del self._links[frame]

    def contradictions(self, frame: str, root: str) -> list[str]:
        """Sentences of links between two frames of which several topics, or single messages, tell different things."""
        said = list[str]()
        for child, link in self._between(frame, root):
            if link.others:
                others = ", ".join(sorted(link.others))
                said.append(f"{others} tells otherwise than {link.topic} where {child} is, and is left out")
            if not link.static and (wild := len(link.rows) - len(link.sound())):
                said.append(f"{wild} messages jump away for a moment with {child}, and are left out")
        return said

    def _between(self, frame: str, root: str) -> Iterator[tuple[str, _Link]]:
        """The frames from one up to before one of those above it, each with its link."""
        at, root = frame.lstrip("/"), root.lstrip("/")
        for above, _ in self.above(frame):
            if at == root:
                return
            yield at, self._links[at]
            at = above

    def robot(self, frame: str, root: str) -> str:
        """The frame between these that hangs in the root itself."""
        return [frame.lstrip("/"), *(name for name, _ in self._between(frame, root))][-1]

    def part(self, frame: str, root: str) -> str:
        """The uppermost of the frames above one in which it stands; none that hangs in the root is left."""
        part = frame.lstrip("/")
        for _, link in self._between(frame, root):
            if not link.stands or link.parent == root.lstrip("/"):
                break
            part = link.parent
        return part

    def placed(self, frame: str, root: str, times: Floats) -> Placed:
        """Where a frame lies in one of those above it at times (n,), s. Raises InputError for one that is not level.

        Also where the other one is not above it, as in a ring of frames. The link to the other one is the odometry; any
        that is nearer to the lidar may be told once alone, if it stands.
        """
        if root.lstrip("/") not in (frame.lstrip("/"), *(name for name, _ in self.above(frame))):
            raise InputError(f"{frame} does not hang in {root}: its frames end before that, or are a ring")
        turn, place = np.tile(np.eye(3), (len(times), 1, 1)), np.zeros((len(times), 3))
        apart, rarest, at = np.zeros(len(times)), np.full(len(times), "odometry"), frame.lstrip("/")
        while at != root.lstrip("/"):
            link = self._links[at]
            by, to, told = link.at(times)
            turn, place = by @ turn, np.einsum("nij,nj->ni", by, place) + to
            moves = link.parent == root.lstrip("/")
            if moves or not link.stands:
                rarest = np.where(told > apart, "odometry" if moves else f"tf of {at!r}", rarest)
                apart = np.maximum(apart, told)
            at = link.parent
        up = float(np.nanmedian(turn[:, 2, 2])) if np.isfinite(turn[:, 2, 2]).any() else 1.0
        if abs(up) < LEVEL:
            raise InputError(f"{frame} is not level in {root}, so that its lidar sees no floor plan")
        headings = np.arctan2(turn[:, 1, 0], turn[:, 0, 0])
        return Placed(np.column_stack((place[:, :2], headings)), apart, rarest, up < 0)


def _from_above(rows: Floats) -> Floats:
    """(n, 3) poses in the plane of samples."""
    x, y, z, w = rows[:, 4:8].T
    return np.column_stack((rows[:, 1:3], np.arctan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z)))
