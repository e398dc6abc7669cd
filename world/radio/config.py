"""Settings of the radio: a range and models that combine, each named by its kind.

What a model does is in `world.radio.air`, of `Capacity` in the gate. The reasons of its drops are outcomes in
radio.csv, which docs/formats.md lists.
"""

from collections.abc import Iterator
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from protocol.codec import MAX_MESSAGE_BYTES
from protocol.messages import ID, MTU_BYTES
from protocol.settings import Chance, Config, NotNegative, Positive, shaped

MAX_MTU_BYTES = MAX_MESSAGE_BYTES - 256
"""What is heard comes with its sender, in a message of the world that may be no longer than others (ours)."""

RobotName = Annotated[str, shaped(ID, "a robot's name, such as r2")]
LinkName = Annotated[str, shaped(r"[a-z][a-z0-9_-]{0,15}>[a-z][a-z0-9_-]{0,15}", "SENDER>RECEIVER, such as r1>r2")]


class LineOfSight(Config):
    """Walls block messages, as they do light or a carrier of 60 GHz. Drops with the reason `walls`."""

    kind: Literal["line_of_sight"] = "line_of_sight"

    def __str__(self) -> str:
        return "line of sight"


class LogDistance(Config):
    """Log-distance path loss with log-normal fading and an attenuation per wall (Rappaport, Wireless Communications).

    A message arrives where 10 n log10(reach / distance) - walls * wall_db + fading is not negative; else `fading`.
    """

    kind: Literal["log_distance"] = "log_distance"
    reach_m: Positive = 8.0
    """Distance in m at which half of the messages arrive without walls. The default is an indoor radio of some mW."""
    exponent: Positive = 3.0
    """Path-loss exponent n: 2 in free space, 2.5 to 3.5 within buildings."""
    wall_db: NotNegative = 6.0
    """Attenuation in dB per wall on the straight way; 5 to 8 for a brick wall at 2.4 GHz."""
    fading_db: NotNegative = 4.0
    """Standard deviation in dB, drawn per message; indoors 3 to 6."""
    link_db: NotNegative = 0.0
    """Standard deviation in dB, drawn once per directed link and run, because receivers and antennas differ."""

    def __str__(self) -> str:
        link = f", {self.link_db:g} dB per link" if self.link_db else ""
        return (
            f"log distance (reach {self.reach_m:g} m, exponent {self.exponent:g}, {self.wall_db:g} dB per wall, "
            f"fading {self.fading_db:g} dB{link})"
        )


class Bernoulli(Config):
    """Each message is lost with the same probability, independently. Drops with the reason `loss`."""

    kind: Literal["bernoulli"] = "bernoulli"
    loss: Chance
    """Probability of loss."""

    def __str__(self) -> str:
        return f"loss {self.loss:.0%}"


class GilbertElliott(Config):
    """Each directed link is good or bad in turns (Gilbert 1960, Elliott 1963). Drops with the reason `burst`."""

    kind: Literal["gilbert_elliott"] = "gilbert_elliott"
    good_s: Positive = 10.0
    """Mean time in the good state, seconds."""
    bad_s: Positive = 2.0
    """Mean time in the bad state, seconds."""
    loss_good: Chance = 0.0
    """Probability of loss in the good state."""
    loss_bad: Chance = 1.0
    """Probability of loss in the bad state."""

    def __str__(self) -> str:
        return f"bursts ({self.bad_s:g} s of {self.loss_bad:.0%} loss, {self.good_s:g} s of {self.loss_good:.0%})"


class Asymmetric(Config):
    """Each directed link has its own probability of loss, fixed for a run. Drops with the reason `asymmetric`."""

    kind: Literal["asymmetric"] = "asymmetric"
    most: Chance = 0.5
    """Upper bound of a link's probability of loss, which is drawn uniformly from 0."""
    links: dict[LinkName, Chance] = Field(default_factory=dict)
    """Probabilities that are given instead of drawn, such as "r1>r2": 1.0."""

    @model_validator(mode="after")
    def _between_two(self) -> Self:
        for link in self.links:
            if len(set(link.split(">"))) < 2:
                raise ValueError(f"links: {link} is from a robot to itself; name two robots")
        return self

    def __str__(self) -> str:
        given = "".join(f", {link} {loss:.0%}" for link, loss in self.links.items())
        return f"asymmetric (each link 0 to {self.most:.0%}{given})"


class Blackout(Config):
    """Nothing passes for a while. Drops with the reason `blackout`."""

    kind: Literal["blackout"] = "blackout"
    begin_s: NotNegative
    """Begin in simulated seconds."""
    end_s: NotNegative
    """End in simulated seconds."""
    robots: list[RobotName] = Field(default_factory=list)
    """Robots that neither send nor hear; empty for all."""

    @model_validator(mode="after")
    def _ends_after_it_begins(self) -> Self:
        if self.end_s <= self.begin_s:
            raise ValueError(f"a blackout from {self.begin_s:g} to {self.end_s:g} s never is: end_s is to be later")
        return self

    def __str__(self) -> str:
        return f"blackout of {', '.join(self.robots) or 'all'} from {self.begin_s:g} to {self.end_s:g} s"


class Latency(Config):
    """Messages arrive later, and may overtake each other."""

    kind: Literal["latency"] = "latency"
    ticks: Annotated[int, Field(ge=1, le=1000)] = 1
    """Ticks from sending to hearing; 1 is the least."""
    jitter: Annotated[int, Field(ge=0, le=1000)] = 0
    """Largest additional delay in ticks, drawn uniformly."""

    def __str__(self) -> str:
        more = f" to {self.ticks + self.jitter}" if self.jitter else ""
        return f"latency {self.ticks}{more} ticks"


class Capacity(Config):
    """A robot's radio carries so much in a second, or in a longer tick, sent and heard together; more is dropped.

    Reasons: `capacity_out` where the sender's capacity is used up, `capacity_in` where the receiver's is.
    """

    kind: Literal["capacity"] = "capacity"
    bytes_per_s: Positive
    """Payload bytes per simulated second and robot."""

    def __str__(self) -> str:
        return f"capacity {self.bytes_per_s:g} B/s"


Model = Annotated[
    LineOfSight | LogDistance | Bernoulli | GilbertElliott | Asymmetric | Blackout | Latency | Capacity,
    Field(discriminator="kind"),
]


class RadioConfig(Config):
    """Who hears whom.

    A message must pass the sender's MTU and capacity, the range, and each model that loses messages, in their order;
    when it arrives, the receiver's capacity.
    """

    range_m: Positive | None = 4.0
    """Range in m, judged at the sending tick (paper III: robots within radio range); null for no limit."""
    mtu_bytes: Annotated[int, Field(ge=64, le=MAX_MTU_BYTES)] = MTU_BYTES
    """The longest message that goes on the air; robots are told it."""
    models: list[Model] = Field(default_factory=list, max_length=100)
    """Further losses and delays in this order, such as [{kind: bernoulli, loss: 0.3}, {kind: line_of_sight}]."""

    def named(self) -> Iterator[str]:
        """Robots that the models name."""
        for model in self.models:
            if isinstance(model, Blackout):
                yield from model.robots
            elif isinstance(model, Asymmetric):
                for link in model.links:
                    yield from link.split(">")

    def __str__(self) -> str:
        reach = f"range {self.range_m:g} m" if self.range_m else "no range limit"
        return ", ".join([reach, *map(str, self.models), f"MTU {self.mtu_bytes:,} B"])
