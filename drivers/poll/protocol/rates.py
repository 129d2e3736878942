"""The line rates that each family's registers know, by `kind` of `[driver]`; usual ones first."""

from __future__ import annotations

BAUDS: dict[str, tuple[int, ...]] = {
    "feetech": (1_000_000, 500_000, 250_000, 115_200, 57_600, 38_400, 128_000, 76_800),
    "dynamixel": (1_000_000, 57_600, 2_000_000, 3_000_000, 4_000_000, 115_200, 9_600, 4_500_000),
    # Factory settings: AX 1000000, MX and RX 57600.
    "dynamixel1": (
        1_000_000, 57_600, 115_200, 500_000, 200_000, 250_000, 400_000, 9_600, 19_200, 2_250_000,
        2_500_000, 3_000_000,
    ),
}  # fmt: skip
