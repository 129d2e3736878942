"""An arm that only sends, as fast as it is told: SAMPLEs packed beforehand, once a millisecond.

python pump.py RATE_HZ … SECONDS: prints the port's path; reads a line from standard input; then
sends at each rate and prints `RATE_HZ FIRST_SEQ LAST_SEQ UNSENT`, UNSENT being what found no room
because nobody read in time.
"""

from __future__ import annotations

import sys
import time

from armd.drivers.serial import wire
from armd.simulator.live.electronics import COUNTS_PER_TURN
from armd.simulator.live.pty_port import PtyPort

JOINTS, SENSORS = 6, 6
SETTLE_HZ = 1000  # first of all, and not counted
HELLO = wire.Hello(
    1, JOINTS, SENSORS, 1000, 1, "SIM-0001", (COUNTS_PER_TURN.bit_length() - 1,) * JOINTS
)
TICK_S = 0.001
PAUSE_S = 0.4  # what is on its way arrives; longer would be silence


def main(rates_hz: list[int], seconds: float) -> None:
    seq, plan = 0, []
    for rate_hz in [SETTLE_HZ, *rates_hz]:
        first = seq
        ticks = [
            _packets(seq + k, rate_hz) for k in range(0, int(rate_hz * seconds), _per_tick(rate_hz))
        ]
        seq += len(ticks) * _per_tick(rate_hz)
        plan.append((rate_hz, first, seq - 1, ticks))
    port = PtyPort()
    print(port.path, flush=True)
    sys.stdin.readline()
    hello = wire.encode_hello(HELLO) + wire.encode_temperature(0, [20.0] * SENSORS)
    for rate_hz, first, last, ticks in plan:
        port.write(b"\0" + hello)
        unsent, due = 0, time.monotonic()
        for packets in ticks:
            due += TICK_S
            time.sleep(max(0.0, due - time.monotonic()))
            unsent += 0 if port.write(packets) else _per_tick(rate_hz)
        time.sleep(PAUSE_S)
        port.read(0.0)  # PINGs, which nobody answers: the clock is not what is measured
        if ticks is not plan[0][3]:
            print(rate_hz, first, last, unsent, flush=True)


def _per_tick(rate_hz: int) -> int:
    return round(rate_hz * TICK_S)


def _packets(first: int, rate_hz: int) -> bytes:
    """A tick's SAMPLEs. The device's time runs at one pace, so that no rate begins in the past."""
    return b"".join(
        wire.encode_sample(seq, seq * 1000, [seq % 1000 + k for k in range(JOINTS)])
        for seq in range(first, first + _per_tick(rate_hz))
    )


if __name__ == "__main__":
    main([int(rate) for rate in sys.argv[1:-1]], float(sys.argv[-1]))
