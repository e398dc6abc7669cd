"""Three hundred commands with an option, a file or a setting that is wrong: made by hand, and mutated from a seed."""

import random
import re
from typing import NamedTuple

from deploy.terminal.settings import settings, to_yaml
from tests.tiny import ROOM

SEED = 13


class Bad(NamedTuple):
    """A command, and the files that it finds in its folder."""

    arguments: list[str]
    files: dict[str, bytes] = {}  # noqa: RUF012  (nobody changes it)

    def __str__(self) -> str:
        return " ".join(word if word.isprintable() else ascii(word) for word in self.arguments)[:80]


NUMBERS = (".nan", "-.inf", "1e9", "[1]", "{a: 1}", "x", "true", "null", "*a", "!!python/name:os.system 1", "'\\e[31m'")
"""In place of a number in a world file."""

WORLDS: tuple[str | bytes, ...] = (
    "",
    "7",
    "[]",
    "\x00",
    b"\xff\xfe\x00\x9f",
    "\x1b[31mboxes",
    "[" * 100_000,
    "{" * 100_000,
    "- " * 3000 + "1",
    "boxes: " + "[" * 50 + "]" * 50,
    "a: &a [x, x]\n"
    + "".join(f"{b}: &{b} [*{a}, *{a}, *{a}]\n" for a, b in zip("abcdefghijk", "bcdefghijkl", strict=True)),
    "&a boxes: [*a]",
    "boxes: !!binary aGVsbG8=",
    "boxes: 2026-11-22",
    "boxes: [[0, 0, 0, 1, 1]]\nboxes: []",
    "boxes: [[0, 0, 0, 1, 1]]\n---\nboxes: []",
    "? [a]\n: 1",
    "boxes: [[0, 0, 0, 1e-9, 1]]",
    "boxes: [[0, 0, 0, 1, 1e-9]]",
    "boxes: [[0, 0, 0, " + "9" * 3000 + ", 1]]",
    "boxes: [[0, 0, 0, " + "1:" * 1500 + "1, 1]]",
    "boxes: [[0, 0, 0, 0x" + "f" * 3000 + ", 1]]",
    "name: " + "x" * 200 + "\nboxes: [[0, 0, 0, 1, 1]]",
    "name: 2026-11-22T00:00:00\nboxes: 3",
    "boxes:\n" + "- [0, 0, 0, 1, 0.1]\n" * 100_000,
    "boxes:\n" + "".join(f"- [{k % 50}, {k // 50}, 0, 0.5, 0.1]\n" for k in range(10_000)),
    "boxes:\n" + "".join(f"- [{k % 50 * 20 - 500}, {k // 50 * 20 - 500}, 0, 0.5, 0.1]\n" for k in range(2500)),
    "boxes:\n" + "".join(f"- [0, 0, {k / 100}, 3, 0.1]\n" for k in range(2400)),
    "walls:\n" + "".join(f"- [0, {k / 10}, 100, {100 - k / 10}]\n" for k in range(1000)),
    "polygons: [[[" + ", ".join(f"[{k * 7919 % 97}, {k * 104729 % 89}]" for k in range(2000)) + "]]]",
    "polygons: [[[[0, 0], [1, 1], [0, 0]]]]",
    "polygons: [[[[0, 0], [1e-9, 0], [0, 1e-9]]]]",
    "polygons: [[]]",
    "walls: [[0, 0, 0, 0]]",
    "walls: [[-900, -900, 900, 900]]",
    ROOM.replace("units: m", "units: [m]"),
    ROOM.replace("units: m", "units: " + "feet" * 900),
    ROOM.replace("[[-1, -0.5, 0]", "[[50, 50, 0]"),
    ROOM.replace("[[-1, -0.5, 0]", "[[0, 1.5, 0]"),
    ROOM.replace("[[-1, -0.5, 0]", "[[0, -0.5, 0]"),
    ROOM + "x: " + "a" * 5000,
    "source: '" + "y" * 11_000_000 + "'",
)

SETTINGS = (
    "seed=2026-11-22",
    "seed=2026-13-45",
    "seed=-1",
    "seed=1e400",
    "seed=" + "9" * 5000,
    "seed=0x" + "f" * 5000,
    "seed=" + "[" * 100_000,
    "seed=" + "[" * 30 + "]" * 30,
    "seed=&a [*a]",
    "seed=!!python/object/apply:os.system [ls]",
    "seed=[/b]",
    "seed=\x1b[2J",
    "seed='\u202e'",
    "seed=!!set {1}",
    "=1",
    "seed",
    "",
    "coverage.grid_m=1e-6",
    "." * 50 + "=1",
    "agent" + ".x" * 2000 + "=1",
    "robots=501",
    "robots=2.5",
    "spec.lidar.beams=4097",
    "spec.lidar.beams=1e9",
    "spec.lidar.rate_hz=1e-300",
    "spec.lidar.range_max_m=101",
    "spec.radius_m=1e-300",
    "spec.radius_m=5",
    "spec.radio_range_m=3",
    "agent.exploration.smallest_object_m=1e-9",
    "agent.filter.particles=1000000",
    "agent.radio.beacon_s=1e-300",
    "agent.radio.beacon_s=6",
    "max_time_s=1e300",
    "until=-3",
    "until=never",
    "snapshot_s=1e-300",
    "radio.models=[{kind: magic}]",
    "radio.models=[{}]",
    "radio.models={}",
    "radio.models=[" + ", ".join(["{kind: line_of_sight}"] * 200) + "]",
    "radio.models=[{kind: blackout, begin_s: 1, end_s: 2, robots: ['[/b]']}]",
    "radio.models=[{kind: blackout, begin_s: 20, end_s: 10}]",
    "radio.models=[{kind: latency, ticks: 1000000}]",
    "radio.models=[{kind: asymmetric, links: {nobody: 1}}]",
    "world='a\\0b'",
    "world=" + "a" * 3000,
    "world=[/b].yaml",
    "world=..",
    "server.real_time=0",
    "server.begin_with=4",
)

CONFIGS: tuple[str | bytes, ...] = (
    "[" * 100_000,
    "- 1",
    "7",
    b"\xff\xfe",
    "a: [1",
    "seed: 2026-13-45",
    "seed: *x",
    "? {a: 1}\n: 2",
    "seed: 1\nseed: 2",
    "wings: 2",
    "1: 2",
    "'\\e[31m': 2",
    "agent: 3",
    "agent: [1]",
    "radio: {range_m: [/b]}",
    "a: &a [x]\nb: [*a, *a]",
    "x: '" + "y" * 11_000_000 + "'",
)

COMMANDS = (
    ["fly"],
    ["run", "--wings"],
    ["run", "--robots", "many"],
    ["run", "--robots", "0"],
    ["run", "--robots", "9" * 5000],
    ["run", "--seed", "2026-11-22"],
    ["run", "--seed", "[/b]"],
    ["run", "--seed", "\x1b[2J"],
    ["run", "--range", "nan"],
    ["run", "--range", "-1"],
    ["run", "--until", "soon"],
    ["run", "--until", "inf"],
    ["run", "--max-time", "inf"],
    ["run", "--real-time", "0"],
    ["run", "--world", "nowhere"],
    ["run", "--world", ""],
    ["run", "--world", "."],
    ["run", "--world", "/dev/zero"],
    ["run", "--world", "[/b]"],
    ["run", "--world", "\x1b]0;x\x07"],
    ["run", "--world", "\u202eyaml"],
    ["run", "--world", "a\nb"],
    ["run", "--world", "a" * 5000],
    ["run", "--config", "absent.yaml"],
    ["run", "--config", "."],
    ["run", "--config", "/dev/zero"],
    ["run", "--config", "a" * 5000],
    ["run", "--world", "room.yaml", "--out", "room.yaml"],
    ["run", "--world", "room.yaml", "--out", "room.yaml/x"],
    ["run", "--world", "room.yaml", "--out", "/proc/x/y"],
    ["run", "--world", "room.yaml", "--out", "a" * 5000],
    ["run", "--world", "room.yaml", "--robots", "400"],
    ["world", "--world", "room.yaml", "--listen", "nowhere"],
    ["world", "--world", "room.yaml", "--listen", "tcp/127.0.0.1:70000"],
    ["world", "--world", "room.yaml", "--listen", "tcp/[/b]:1"],
    ["world", "--world", "room.yaml", "--secrets", "absent/secrets"],
    ["world", "--world", "room.yaml", "--secrets", "room.yaml"],
    ["world", "--world", "room.yaml", "--secrets", "."],
    ["world", "--world", "room.yaml", "--secrets", "new", "--out", "room.yaml"],
    ["agent", "--id", "r1"],
    ["agent", "--id", "r1", "--connect", "nowhere"],
    ["agent", "--id", "R1", "--connect", "tcp/127.0.0.1:1"],
    ["agent", "--id", "../r1", "--connect", "tcp/127.0.0.1:1"],
    ["agent", "--id", "*", "--connect", "tcp/127.0.0.1:1"],
    ["agent", "--id", "\x1b[2J", "--connect", "tcp/127.0.0.1:1"],
    ["agent", "--id", "r1", "--connect", "tcp/127.0.0.1:1", "--secrets", "absent"],
    ["agent", "--id", "r1", "--connect", "tcp/127.0.0.1:1", "--secrets", "room.yaml"],
    ["agent", "--id", "r1", "--connect", "tcp/127.0.0.1:1", "--secrets", "/dev/zero"],
    ["agent", "--id", "r1", "--connect", "\x1b[2J"],
    ["world", "--world", "room.yaml", "--listen", "tcp/0.0.0.0:7447"],
    ["world", "--world", "room.yaml", "--listen", "tcp/[::]:7447"],
    ["world", "--world", "room.yaml", "--listen", "tls/127.0.0.1:7447"],
    ["world", "--world", "room.yaml", "--certs", "absent"],
    ["world", "--world", "room.yaml", "--certs", "room.yaml"],
    ["world", "--world", "room.yaml", "--certs", "absent", "--secrets", "absent"],
    ["agent", "--id", "r1", "--connect", "tls/127.0.0.1:1"],
    ["agent", "--id", "r1", "--connect", "tls/127.0.0.1:1", "--certs", "absent"],
    ["agent", "--connect", "tls/127.0.0.1:1", "--certs", "."],
    ["certs", "room.yaml"],
    ["certs", "room.yaml/new", "--robots", "1"],
    ["certs", "/proc/new", "--robots", "1"],
    ["certs", "new", "--robots", "0"],
    ["certs", "new", "--robots", "9" * 5000],
    ["certs", "new", "--robots", "../r1"],
    ["certs", "new", "--robots", "world"],
    ["certs", "new", "--robots", "r1,,r2"],
    ["certs", "new", "--host", "a b"],
    ["certs", "new", "--host", "\x1b[2J"],
    ["certs", "absent", "--revoke", "r1"],
    ["certs", "new", "--robots", "1", "--revoke", "r1"],
    ["router", "--write", "new"],
    ["router", "--write", "new", "--listen", "tcp/0.0.0.0:7447"],
    ["router", "--listen", "nowhere"],
    ["router", "--listen", "tcp/0.0.0.0:7447"],
    ["router", "--certs", "absent"],
    ["router", "--secrets", "absent"],
    ["bandwidth", "absent"],
    ["bandwidth", "."],
    ["bandwidth", "room.yaml"],
    ["bandwidth", "[/b]"],
    ["bandwidth"],
    ["bench", "wings"],
    ["bench", "lidar", "--jobs", "0"],
    ["export", "absent", "--to", "svg"],
    ["export", "room.yaml", "--to", "dxf"],
    ["export", ".", "--to", "geojson"],
    ["export", ".", "--to", "carmen", "--frame", "own"],
    ["export", "/dev/zero", "--to", "map_server"],
    ["export", ".", "--to", "video"],
    ["import", "absent", "--out", "new.yaml"],
    ["import", "room.yaml", "--out", "new.yaml"],
    ["import", "/dev/zero", "--out", "new.yaml"],
    ["import", "absent.png", "--out", "new.yaml"],
    ["import", "absent.png", "--width", "nan", "--out", "new.yaml"],
    ["worlds", "--yaml"],
    ["config", "extra"],
)


def by_hand() -> list[Bad]:
    """Commands that somebody thought of; each of them once did, or could do, harm."""
    room = {"room.yaml": ROOM.encode()}
    return [
        *(Bad(["run", "--world", "bad.yaml"], {"bad.yaml": _bytes(text)}) for text in WORLDS),
        *(Bad(["run", "--world", "room.yaml", "--set", setting], room) for setting in SETTINGS),
        *(Bad(["run", "--config", "bad.yaml"], {"bad.yaml": _bytes(text)}) for text in CONFIGS),
        *(Bad(arguments, room) for arguments in COMMANDS),
    ]


def mutated(count: int) -> list[Bad]:
    """Commands of which one value was made wrong by chance."""
    rng = random.Random(SEED)
    spots = list(re.finditer(r"-?\d+(\.\d+)?", ROOM))
    keys = [one.key for one in settings() if "[" not in one.key]
    lines = [line for line in to_yaml().splitlines() if re.match(r" *\w+: ", line)]
    made = []
    while len(made) < count:
        match rng.randrange(4):
            case 0:  # a number of a world file
                spot = rng.choice(spots)
                text = ROOM[: spot.start()] + rng.choice(NUMBERS) + ROOM[spot.end() :]
                made.append(Bad(["run", "--world", "bad.yaml"], {"bad.yaml": text.encode()}))
            case 1:  # a world file that ends within a list
                end = rng.choice([at for at in range(len(ROOM)) if ROOM[:at].count("[") > ROOM[:at].count("]")])
                made.append(Bad(["run", "--world", "bad.yaml"], {"bad.yaml": ROOM[:end].encode()}))
            case 2:  # a setting
                value = rng.choice(("[[1]]", "{a: {b: 1}}", "*a", "[" * 40, "!!set {}", "'"))
                made.append(Bad(["run", "--set", f"{rng.choice(keys)}={value}"]))
            case _:  # a line of a file of settings
                name = rng.choice(lines).partition(":")[0]
                text = re.sub(
                    rf"(?m)^{name}: .*$", f"{name}: {rng.choice(('[[1]]', '&b {b: 1}', '%', '[', '*a'))}", to_yaml()
                )
                made.append(Bad(["run", "--config", "bad.yaml"], {"bad.yaml": text.encode()}))
    return made


def all_cases() -> list[Bad]:
    """Three hundred of them."""
    cases = by_hand()
    return cases + mutated(300 - len(cases))


def _bytes(text: str | bytes) -> bytes:
    return text if isinstance(text, bytes) else text.encode()
