"""Write down what the arms publish: points as they are, all else as JSON lines."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import zenoh

SETTINGS = {
    "mode": '"peer"',
    "listen/endpoints": "[]",
    "connect/endpoints": '["tcp/127.0.0.1:7447", "tcp/127.0.0.1:7448"]',
    "connect/timeout_ms": "-1",
    "connect/exit_on_failure": "false",
    "connect/retry": '{"period_init_ms":100,"period_max_ms":300,"period_increase_factor":2}',
    "scouting/multicast/enabled": "false",
}


def main(folder: Path) -> None:
    config = zenoh.Config()
    for key, value in SETTINGS.items():
        config.insert_json5(key, value)
    with zenoh.open(config) as session:
        told = [
            session.declare_subscriber(f"armd/*/{what}", zenoh.handlers.FifoChannel(10000))
            for what in ("point", "event", "health", "measurement")
        ]
        alive = session.liveliness().declare_subscriber("armd/*/alive", history=True)
        while True:
            for subscriber in told:
                while (sample := subscriber.try_recv()) is not None:
                    _, serial, what = str(sample.key_expr).split("/")
                    point = what == "point"
                    with (folder / f"{serial}.{'point' if point else 'json'}").open("ab") as file:
                        file.write(sample.payload.to_bytes() + (b"" if point else b"\n"))
            while (sample := alive.try_recv()) is not None:
                serial = str(sample.key_expr).split("/")[1]
                here = sample.kind == zenoh.SampleKind.PUT
                (folder / f"{serial}.alive").write_text("here" if here else "gone")
            time.sleep(0.02)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
