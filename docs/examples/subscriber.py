"""A subscriber in ten lines: print where the tip is, and tell when points were lost."""

import sys

import armd

endpoint = sys.argv[1] if len(sys.argv) > 1 else armd.ENDPOINT
with armd.connect(endpoint=endpoint) as arm:
    for point in arm.points(seconds=2):
        x, y, z = point.position_mm
        print(f"{point.seq}  {x:9.3f} {y:9.3f} {z:9.3f} mm  {point.flags.name}")
    print("lost:", arm.lost.total)
