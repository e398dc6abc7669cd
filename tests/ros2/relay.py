"""Topics of real ROS 2 (rclpy over DDS) to and from Zenoh, in the form of rmw_zenoh; run by a Python that has rclpy.

It shares no code with the project: types, hashes and CDR are those of rclpy.
`python relay.py '{"endpoint": "tcp/127.0.0.1:7447", "links": [["in", "/a/odom", "/b/odom", "nav_msgs/Odometry"]]}'`:
`in` goes from DDS to Zenoh, `out` the other way; then the topic's name on Zenoh, that on DDS, and the type.
"""

import itertools
import json
import os
import sys
import time
from contextlib import suppress
from importlib import import_module

import rclpy
import zenoh
import zenoh.ext
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message, serialize_message


def hash_of(node, topic, kind):
    """Type hash as rclpy knows it, of a publisher that is made for it."""
    publisher = node.create_publisher(kind, f"{topic}_type", 1)
    while not (found := node.get_publishers_info_by_topic(f"{topic}_type")):
        time.sleep(0.05)
    node.destroy_publisher(publisher)
    return str(found[0].topic_type_hash)


class Relay(Node):
    def __init__(self, session, links):
        super().__init__("relay", namespace="/relay")
        self.numbers, self.session, self.kept = itertools.count(), session, []
        self.tell("NN")
        for way, on_zenoh, on_dds, name, *latched in links:
            package, _, message = name.partition("/")
            kind = getattr(import_module(f"{package}.msg"), message)
            typed = f"{package}::msg::dds_::{message}_/{hash_of(self, on_dds, kind)}"
            quality = QoSProfile(depth=10)
            if latched:
                quality = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
            words = f"{on_zenoh.replace('/', '%')}/{typed}/:{'1' if latched else ''}:,{quality.depth}:,:,:,,"
            key = f"0{on_zenoh}/{typed}"
            (self.into_zenoh if way == "in" else self.out_of_zenoh)(key, words, on_dds, kind, quality)

    def tell(self, what, rest=""):
        zid, number = self.session.info.zid(), next(self.numbers)
        token = f"@ros2_lv/0/{zid}/0/{number}/{what}/%/%relay/relay{rest and '/' + rest}"
        self.kept.append(self.session.liveliness().declare_token(token))

    def into_zenoh(self, key, words, topic, kind, quality):
        publisher, gid, sequence = self.session.declare_publisher(key), os.urandom(16), itertools.count(1)

        def forward(message):
            head = zenoh.ext.Int64(next(sequence)), zenoh.ext.Int64(time.time_ns())
            publisher.put(serialize_message(message), attachment=zenoh.ext.z_serialize((*head, gid)))

        self.kept.append(self.create_subscription(kind, topic, forward, quality))
        self.tell("MP", words)

    def out_of_zenoh(self, key, words, topic, kind, quality):
        publisher = self.create_publisher(kind, topic, quality)

        def forward(sample):
            if sample.attachment is not None and len(sample.attachment.to_bytes()) == 33:  # else rmw_zenoh drops it
                publisher.publish(deserialize_message(sample.payload.to_bytes(), kind))

        if quality.durability == DurabilityPolicy.TRANSIENT_LOCAL:
            history = zenoh.ext.HistoryConfig(detect_late_publishers=True)
            subscriber = zenoh.ext.declare_advanced_subscriber(self.session, key, forward, history=history)
        else:
            subscriber = self.session.declare_subscriber(key, forward)
        self.kept.append(subscriber)
        self.tell("MS", words)


def main():
    asked = json.loads(sys.argv[1])
    config = zenoh.Config.from_json5(
        json.dumps(
            {
                "mode": "client",
                "connect": {"endpoints": [asked["endpoint"]], "timeout_ms": 10_000},
                "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
                "timestamping": {"enabled": True},
            }
        )
    )
    rclpy.init()
    with zenoh.open(config) as session:
        relay = Relay(session, asked["links"])
        print("ready", flush=True)
        with suppress(KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
            rclpy.spin(relay)


if __name__ == "__main__":
    main()
