"""Write down everything the arm publishes: points as they are, events and health as JSON lines."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import zenoh


def main(folder: Path) -> None:
    config = zenoh.Config()
    for key, value in {
        "mode": '"client"',
        "connect/endpoints": '["tcp/127.0.0.1:7447"]',
        "connect/timeout_ms": "-1",
        "connect/retry": '{"period_init_ms":100,"period_max_ms":300,"period_increase_factor":2}',
        "scouting/multicast/enabled": "false",
    }.items():
        config.insert_json5(key, value)
    with zenoh.open(config) as session:
        files = {name: (folder / name).open("ab", buffering=0) for name in ("point", "json")}
        subscriber = session.declare_subscriber("armd/SIM-0001/*")
        alive = session.liveliness().declare_subscriber("armd/*/alive", history=True)
        while True:
            while (sample := subscriber.try_recv()) is not None:
                if str(sample.key_expr).endswith("/point"):
                    files["point"].write(sample.payload.to_bytes())
                else:
                    files["json"].write(sample.payload.to_bytes() + b"\n")
            while (sample := alive.try_recv()) is not None:
                (folder / "alive").write_text(str(sample.kind == zenoh.SampleKind.PUT))
            time.sleep(0.02)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
