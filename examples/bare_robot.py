"""A robot without any of our packages: docs/protocol.md with Zenoh, MessagePack and numpy.

    wireswarm world --world apartment --robots 1 --listen tcp/127.0.0.1:7447 \\
        --set spec.odometry.noisy=false --set spec.lidar.turning=false
    python examples/bare_robot.py r1 tcp/127.0.0.1:7447

It drives to the nearest frontier of a grid, by odometry. Its map is of lines through the straight parts of scans.
"""

import json
import struct
import sys
import time
from queue import SimpleQueue

import msgpack
import numpy as np
import zenoh

CELL_M, CELLS, OFF_M = 0.1, 400, 0.05  # OFF_M: from a line, for a point to be on it
UNKNOWN, FREE, WALL = 0, 1, 2


class Wall:
    """A line through points, seen from its left. A point x, y is the complex number x + iy."""

    def __init__(self, sums: np.ndarray, points: np.ndarray) -> None:
        """sums: of 1, z and z^2 over all points z. points: those on the line that it reaches, in its direction."""
        self.sums, self.middle = sums, sums[1] / sums[0]
        self.along = np.sqrt(sums[2] - sums[1] * self.middle)
        self.along *= np.sign((np.conj(self.along) * (points[-1] - points[0])).real) / abs(self.along)
        self.ends = self.middle + np.sort(self.of(points).real)[[0, -1]] * self.along

    def of(self, points: np.ndarray) -> np.ndarray:
        """Points as places along the line and, imaginary, to its left."""
        return (points - self.middle) * np.conj(self.along)

    def continues(self, other: "Wall") -> bool:
        """Whether two walls are parts of one that lie beside each other."""
        (low, high), (first, last) = self.of(self.ends).real, self.of(other.ends)
        return bool(low - 0.1 < last.real > first.real < high + 0.1 and max(abs(first.imag), abs(last.imag)) < OFF_M)


def straight(points: np.ndarray) -> list[np.ndarray]:
    """Straight parts of points in a row: split at the farthest from the chord, while that is off."""
    chord = points[-1] - points[0]
    off = np.abs(((points - points[0]) * np.conj(chord)).imag) / max(abs(chord), 1e-9)
    if off.max() > OFF_M and len(points) > 5:
        return straight(points[: off.argmax() + 1]) + straight(points[off.argmax() :])
    return [points[1:-1]] if len(points) > 5 and abs(chord) > 0.25 else []


def grown(mask: np.ndarray) -> np.ndarray:
    """The mask with the neighbours of its cells."""
    padded = np.pad(mask, 1)
    return mask | padded[2:, 1:-1] | padded[:-2, 1:-1] | padded[1:-1, 2:] | padded[1:-1, :-2]


def cells(points: np.ndarray) -> tuple:
    """Rows and columns of points on the grid."""
    return tuple(np.clip(np.array([points.real, points.imag]) / CELL_M + CELLS / 2, 0, CELLS - 1).astype(int))


class BareRobot:
    """What the robot knows, and where it goes."""

    def __init__(self, spec: dict) -> None:
        """spec: of the Welcome."""
        lidar, self.speed_mps = spec["lidar"], spec["max_speed_mps"]
        turned = np.arange(lidar["beams"]) * lidar["field_of_view_deg"] / lidar["beams"] * (-1) ** lidar["clockwise"]
        self.bearings = np.radians(lidar["mount_yaw_deg"] + lidar["first_beam_deg"] + turned)
        self.grid, self.walls, self.goal = np.zeros((CELLS, CELLS), np.uint8), [], None

    def look(self, place: complex, theta: float, ranges: np.ndarray) -> None:
        """Enter a scan into grid and walls."""
        rays, hit, reach = np.exp(1j * (self.bearings + theta)), np.isfinite(ranges), np.nan_to_num(ranges, posinf=0.0)
        for away in np.arange(0.0, reach.max(), CELL_M / 2):
            passed = cells(place + away * rays[reach > away + CELL_M])
            self.grid[passed] = np.maximum(self.grid[passed], FREE)
        points = place + reach * rays
        self.grid[cells(points[hit])] = WALL
        jumps = np.flatnonzero(np.abs(np.diff(reach)) > 0.05 + 0.06 * reach[1:]) + 1
        for part in np.split(np.arange(len(points)), jumps):
            for piece in straight(points[part]) if hit[part].all() else ():
                wall = Wall(np.array([len(piece), piece.sum(), (piece**2).sum()]), piece)
                while known := next((one for one in self.walls if one.continues(wall)), None):
                    self.walls.remove(known)
                    wall = Wall(known.sums + wall.sums, np.array([known.ends[0], *wall.ends, known.ends[1]]))
                self.walls.append(wall)

    def plan(self, place: complex) -> None:
        """Choose a point two cells down the way to the nearest frontier; None where there is none."""
        free = (self.grid == FREE) & ~grown(grown(self.grid == WALL))
        wave, reached, known, self.goal = grown(self.grid == UNKNOWN) & free, [], np.argwhere(free), None
        here = tuple(known[np.abs(known - cells(np.array(place))).sum(1).argmin()])
        wave[here] = False
        while wave.any() and not wave[here]:
            reached.append(wave)
            wave, free = grown(wave) & free & ~wave, free & ~wave
        if wave.any():
            ahead = np.argwhere(reached[-2:][0])
            self.goal = complex(*ahead[np.abs(ahead - here).sum(1).argmin()] - CELLS / 2 + 0.5) * CELL_M

    def answer(self, seen: dict) -> dict:
        """The Action on an Observation."""
        (x, y, theta), tick = seen["odometry"], seen["tick"]
        self.look(complex(x, y), theta, np.frombuffer(seen["ranges"], "<f4").astype(float))
        if tick % 3 == 0:
            self.plan(complex(x, y))
        if self.goal is None:
            return {"tick": tick, "speed_mps": 0.0, "turn_rps": 0.0, "complete": True}
        by = float(np.angle((self.goal - complex(x, y)) * np.exp(-1j * theta)))
        return {"tick": tick, "speed_mps": self.speed_mps * (abs(by) < 0.4), "turn_rps": max(-2.0, min(2.0, 2.5 * by))}

    def wireframe(self) -> bytes:
        """The walls as telemetry."""
        n, ends = len(self.walls), np.array([wall.ends for wall in self.walls], "<c8").tobytes()
        rest = b"\2" * 2 * n + np.arange(2 * n, dtype="<u2").tobytes() + np.ones(n, "<f4").tobytes() + b"\1" * n
        return struct.pack("<4sBII", b"WSWF", 1, 2 * n, n) + ends + rest


def main(robot: str, endpoint: str) -> None:
    """Live in the world at an endpoint."""
    settings = {"mode": "client", "connect": {"endpoints": [endpoint]}, "scouting": {"multicast": {"enabled": False}}}
    box, said, how = SimpleQueue(), {"tick": -1}, {"congestion_control": zenoh.CongestionControl.BLOCK, "express": True}
    with zenoh.open(zenoh.Config.from_json5(json.dumps(settings))) as session:
        told, me = b"", msgpack.packb({"version": 3, "robot": robot, "session": str(session.info.zid())})
        while b"spec" not in told and b"reason" not in told:  # no world is there yet
            time.sleep(0.2)
            told = b"".join(bytes((r.ok or r.err).payload) for r in session.get(f"robots/{robot}/srv/join", payload=me))
        told = msgpack.unpackb(told)
        explorer = BareRobot(told["spec"] if "spec" in told else sys.exit(f"{robot} is not let in: {told['reason']}"))
        session.declare_subscriber(f"robots/{robot}/in/**", lambda one: box.put((str(one.key_expr), one.payload)))
        out = {name: session.declare_publisher(f"robots/{robot}/out/{name}", **how) for name in ("map", "act")}
        while not all(publisher.matching_status.matching for publisher in out.values()):
            time.sleep(0.01)
        with session.liveliness().declare_token(f"robots/{robot}/alive"):
            while not (come := box.get())[0].endswith("/end"):
                if come[0].endswith("/obs"):
                    seen = msgpack.unpackb(come[1].to_bytes())
                    if seen["tick"] != said["tick"]:
                        said = explorer.answer(seen)
                        out["map"].put(msgpack.packb({"tick": said["tick"], "wireframe": explorer.wireframe()}))
                    out["act"].put(msgpack.packb(said))
        print(f"{robot}: {msgpack.unpackb(come[1].to_bytes())['reason']}")


if __name__ == "__main__":
    main(*sys.argv[1:]) if len(sys.argv) == 3 else sys.exit(__doc__)
