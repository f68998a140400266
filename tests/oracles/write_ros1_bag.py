"""write_ros1_bag.py SPEC FILE: the messages of a specification (see bags_test.py) as a bag of ROS 1, by Debian's rosbag."""

import json
import pathlib
import sys

import genpy
import rosbag
import roslib.message


def filled(message, value):
    """A message with the values of a specification, whose stamps are named as in ROS 2."""
    for name, given in value.items():
        kind = type(getattr(message, name))
        if kind is genpy.Time:
            setattr(message, name, genpy.Time(given["sec"], given["nanosec"]))
        elif isinstance(given, dict) and "file" in given:
            with open(given["file"], "rb") as stream:
                stream.seek(given["offset"])
                setattr(message, name, stream.read(given["bytes"]))
        elif isinstance(given, dict):
            filled(getattr(message, name), given)
        elif given and isinstance(given[0] if isinstance(given, list) else None, dict):
            element = roslib.message.get_message_class(message._slot_types[message.__slots__.index(name)][:-2])
            setattr(message, name, [filled(element(), each) for each in given])
        else:
            setattr(message, name, given)
    return message


spec = json.loads(pathlib.Path(sys.argv[1]).read_text())
options = spec["options"]
with rosbag.Bag(sys.argv[2], "w", compression=options.get("compression", "none"),
                chunk_threshold=options.get("chunk_bytes", 768 * 1024)) as bag:
    for each in spec["messages"]:
        topic = spec["topics"][each["topic"]]
        message = filled(roslib.message.get_message_class(topic["type"].replace("/msg/", "/"))(), each["value"])
        log_ns = int(each["log_ns"])
        bag.write(topic["name"], message, genpy.Time(log_ns // 10**9, log_ns % 10**9))
