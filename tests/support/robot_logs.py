"""Files as robots' own programs record them: a LeRobot data set, a ROS 2 bag by rosbags."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

MOTORS = ["shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper"]
STORE = get_typestore(Stores.ROS2_HUMBLE)
JOINTS = MOTORS[:5]
KIND = "sensor_msgs/msg/JointState"


def dataset(folder: Path, names: Any, states: list[np.ndarray], *, per_file: bool) -> Path:
    """Episodes as LeRobot lays them out: version 2.1 a file each, version 3 all in one."""
    (folder / "meta").mkdir(parents=True)
    width = states[0].shape[1]
    features = {
        "observation.state": {"dtype": "float32", "shape": [width], "names": names},
        "action": {"dtype": "float32", "shape": [width], "names": names},
    }
    version = "v2.1" if per_file else "v3.0"
    info = {"codebase_version": version, "fps": 30, "features": features}
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    chunk = folder / "data" / "chunk-000"
    chunk.mkdir(parents=True)
    tables = []
    for episode, state in enumerate(states):
        n = len(state)
        columns = {
            "observation.state": pa.array(
                state.astype(np.float32).tolist(), pa.list_(pa.float32())
            ),
            "action": pa.array((state + 50).astype(np.float32).tolist(), pa.list_(pa.float32())),
            "timestamp": pa.array(np.arange(n, dtype=np.float32) / 30),
            "frame_index": pa.array(np.arange(n)),
            "episode_index": pa.array(np.full(n, episode)),
            "index": pa.array(np.arange(n) + episode * n),
        }
        tables.append(pa.table(columns))
        if per_file:
            pa.parquet.write_table(tables[-1], chunk / f"episode_{episode:06d}.parquet")
    if not per_file:
        pa.parquet.write_table(pa.concat_tables(tables), chunk / "file-000.parquet")
    return folder


def bag(path: Path, plugin: StoragePlugin, topics: tuple[str, ...] = ("/joint_states",)) -> Path:
    """Written by rosbags; the second message has its joints in another order."""
    state, header = STORE.types[KIND], STORE.types["std_msgs/msg/Header"]
    stamp = STORE.types["builtin_interfaces/msg/Time"]
    empty = np.zeros(0)
    with Writer(path, version=9, storage_plugin=plugin) as writer:
        for topic in topics:
            connection = writer.add_connection(topic, KIND, typestore=STORE)
            for i in range(3):
                names = [*JOINTS, "gripper"] if i != 1 else ["gripper", *reversed(JOINTS)]
                angles = {name: 0.1 * k + 0.01 * i for k, name in enumerate(names)}
                message = state(
                    header=header(stamp=stamp(sec=1_772_000_000 + i, nanosec=5), frame_id="base"),
                    name=names,
                    position=np.array([angles[name] for name in names]),
                    velocity=empty,
                    effort=empty,
                )
                data = STORE.serialize_cdr(message, KIND)
                writer.write(connection, 1_772_000_000_000_000_000 + i, data)
    return path
