"""What the robot descriptions (URDF, MJCF) of the known arms say, number for number: lengths in
metres, angles in radians, masses in kilograms. Facts taken over by hand from the files named; an
angle is written as the file prints it, so 1.5708 is a quarter turn that was rounded.
"""

from __future__ import annotations

import math
from typing import NamedTuple

Triple = tuple[float, float, float]


class Joint(NamedTuple):
    xyz: Triple
    rpy: Triple
    axis: Triple
    limits: tuple[float, float] | None = None
    direction: int = 1  # of armd's angle, seen from this joint's


class Link(NamedTuple):
    """What moves with a joint: parts as (mass, centre in the joint's child frame)."""

    parts: tuple[tuple[float, Triple], ...]

    @property
    def mass_kg(self) -> float:
        return sum(mass for mass, _ in self.parts)

    @property
    def centre(self) -> list[float]:
        moments = [[mass * x for x in at] for mass, at in self.parts]
        return [sum(column) / self.mass_kg for column in zip(*moments, strict=True)]


class Description(NamedTuple):
    joints: tuple[Joint, ...]
    tip: Triple  # in the last joint's child frame
    base_mm: Triple  # where armd's base frame stands in the file's
    links: tuple[Link, ...] = ()


X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
MINUS_X, MINUS_Z = (-1.0, 0.0, 0.0), (0.0, 0.0, -1.0)
NONE = (0.0, 0.0, 0.0)
TURN = (-math.pi, math.pi)


def degrees(low: float, high: float) -> tuple[float, float]:
    return (math.radians(low), math.radians(high))


def one(mass: float, *centre: float) -> Link:
    x, y, z = centre
    return Link(((mass, (x, y, z)),))


#: TheRobotStudio/SO-ARM100, Simulation/SO100/so100.urdf
SO100 = Description(
    joints=(
        Joint((0.0, -0.0452, 0.0165), (1.57079, 0.0, 0.0), Y, (-2.0, 2.0)),
        Joint((0.0, 0.1025, 0.0306), (-1.8, 0.0, 0.0), X, (0.0, 3.5)),
        Joint((0.0, 0.11257, 0.028), (1.57079, 0.0, 0.0), X, (-3.14158, 0.0)),
        Joint((0.0, 0.0052, 0.1349), (-1.0, 0.0, 0.0), X, (-2.5, 1.2)),
        Joint((0.0, -0.0601, 0.0), (0.0, 1.57079, 0.0), Y, (-3.14158, 3.14158)),
    ),
    tip=NONE,
    base_mm=NONE,
)

#: TheRobotStudio/SO-ARM100, Simulation/SO101/so101_new_calib.urdf; the tip is its gripper frame
SO101 = Description(
    joints=(
        Joint((0.0388353, 0, 0.0624), (3.14159, 0, -3.14159), Z, (-1.91986, 1.91986), -1),
        Joint((-0.0303992, -0.0182778, -0.0542), (-1.5708, -1.5708, 0), Z, (-1.74533, 1.74533)),
        Joint((-0.11257, -0.028, 0), (0, 0, 1.5708), Z, (-1.69, 1.69)),
        Joint((-0.1349, 0.0052, 0), (0, 0, -1.5708), Z, (-1.65806, 1.65806)),
        Joint((0, -0.0611, 0.0181), (1.5708, 0.0486795, 3.14159), Z, (-2.74385, 2.84121)),
    ),
    tip=(-0.0079, -0.000218121, -0.0981274),
    base_mm=(38.8353, 0, 0),
    links=(
        one(0.100006, -0.0307604, -1.66727e-05, -0.0252713),
        one(0.103, -0.0898471, -0.00838224, 0.0184089),
        one(0.104, -0.0980701, 0.00324376, 0.0182831),
        one(0.079, -0.000103312, -0.0386143, 0.0281156),
        Link(
            (
                (0.087, (0.000213627, 0.000245138, -0.025187)),
                # the jaw at its zero: a quarter turn about x at (20.2, 18.8, −23.4) mm
                (0.012, (0.0202 - 0.00157495, 0.0188 - 0.0192755, -0.0234 - 0.0300244)),
            )
        ),
    ),
)

#: s1lent4gnt/koch-v1-1, simulation/follower.urdf; masses and limits of the same bodies in
#: google-deepmind/mujoco_menagerie, low_cost_robot_arm.xml, whose elbow turns the other way
KOCH = Description(
    joints=(
        Joint((0.012, 0, 0.0409), NONE, MINUS_Z, (-2.2, 2.2), -1),
        Joint((0, -0.0209, 0.0154), NONE, Y, (-1.57, 0.6)),
        Joint((-0.0148, 0.0065, 0.1083), NONE, Y, (-1.45, 1.57)),
        Joint((-0.10048, 5e-05, 0.0026999), NONE, Y, (-2.0, 2.0)),
        Joint((-0.045, 0.013097, 0), NONE, X, (-3.14, 3.14)),
    ),
    tip=(-0.0668, 0, 0),  # between the pads
    base_mm=(12, 0, 0),
    links=(
        one(0.05014, 0.011924, -0.00048792, 0.013381),
        one(0.050177, 0.0011747, 0.02097, 0.071547),
        one(0.06379, -0.05537, 0.014505, 0.0028659),
        one(0.019805, -0.02652, 0.019195, -9.0614e-06),
        Link(
            (
                (0.029277, (-0.019091, 0.0053379, 0.00018011)),
                (0.012831, (-0.01315 - 0.02507, -0.0075 + 0.0010817, 0.0145 - 0.01414)),
            )
        ),
    ),
)

#: Interbotix/interbotix_ros_manipulators, vx300s.urdf.xacro; the tip is ee_arm_link
VX300S = Description(
    joints=(
        Joint((0, 0, 0.079), NONE, Z, TURN),
        Joint((0, 0, 0.04805), NONE, Y, degrees(-106, 72)),
        Joint((0.05955, 0, 0.3), NONE, Y, degrees(-101, 92)),
        Joint((0.2, 0, 0), NONE, X, TURN),
        Joint((0.1, 0, 0), NONE, Y, degrees(-107, 128)),
        Joint((0.069744, 0, 0), NONE, X, TURN),
    ),
    tip=(0.042825, 0, 0),
    base_mm=NONE,
    links=(
        one(0.798614, 0.0002592330, -0.0000033552, 0.0116129),
        one(0.792592, 0.0206949, 0.0000000004, 0.226459),
        one(0.322228, 0.105723, 0, 0),
        one(0.414823, 0.0513477, 0.00680462, 0),
        one(0.115395, 0.046743, -0.0000076652, 0.010565),
        one(0.097666, 0.023001, 0, 0.011523),
    ),
)

#: as above, wx250s.urdf.xacro
WX250S = Description(
    joints=(
        Joint((0, 0, 0.072), NONE, Z, TURN),
        Joint((0, 0, 0.03865), NONE, Y, degrees(-108, 114)),
        Joint((0.04975, 0, 0.25), NONE, Y, degrees(-123, 92)),
        Joint((0.175, 0, 0), NONE, X, TURN),
        Joint((0.075, 0, 0), NONE, Y, degrees(-100, 123)),
        Joint((0.065, 0, 0), NONE, X, TURN),
    ),
    tip=(0.043, 0, 0),
    base_mm=NONE,
    links=(
        one(0.480879, 0.0000223482, 0.0000414609, 0.0066287),
        one(0.430811, 0.0171605, 0.0000002725, 0.191323),
        one(0.234589, 0.107963, 0.000115876, 0),
        one(0.220991, 0.0374395, 0.00522252, 0),
        one(0.084957, 0.04236, -0.000010663, 0.010577),
        one(0.072885, 0.021631, 0.0000002516, 0.01141),
    ),
)

#: ROBOTIS-GIT/open_manipulator, omx_f.urdf; the tip is end_effector_link; limits of ±2π say nothing
OMX = Description(
    joints=(
        Joint((-0.01125, 0, 0.034), NONE, Z),
        Joint((0, 0, 0.0635), NONE, Y),
        Joint((0.0415, 0, 0.11315), NONE, Y),
        Joint((0.162, 0, 0), NONE, Y),
        Joint((0.0287, 0, 0), NONE, X),
    ),
    tip=(0.09193, -0.0016, 0),
    base_mm=(-11.25, 0, 0),
    links=(
        one(0.065987041, -6.2236205e-06, 0.0006049232, 0.047418803),
        one(0.087221471, 0.018089916, 0.00029778758, 0.099005452),
        one(0.083759129, 0.087398602, 0.00041310065, -0.003582921),
        one(0.029975063, 0.02323498, 6.7735378e-05, 0.0059761312),
        Link(
            (
                (0.043810887, (0.028072407, 2.413594100e-05, 0.013528914)),
                (0.012090677, (0.0295 + 0.016164565, 0.0075 + 0.0012731032, 0.00027291598)),
                (0.012090677, (0.0295 + 0.016164565, -0.0108 + 0.0012731032, 0.00027291598)),
            )
        ),
    ),
)

#: as above, omx_l.urdf; the tip is 29.8 mm beyond the roll's frame and 17.5 mm off its axis
OMX_LEADER = Description(
    joints=(
        Joint((-0.0095, 0, 0.0545), NONE, Z),
        Joint((0, 0, 0.042), NONE, Y),
        Joint((0.0375, 0, 0.09), NONE, Y),
        Joint((0.1275, 0, 0), NONE, Y),
        Joint((0.0287, 0, 0), NONE, X),
    ),
    tip=(0.0298, 0, 0.0175),
    base_mm=(-9.5, 0, 0),
    links=(
        one(0.025270951, 2.8350399e-05, 0.00027511324, 0.031280924),
        one(0.047706231, 0.014249177, 0.00017241147, 0.06876064),
        one(0.047706231, 0.082827424, 0.00017241501, 0.00018239232),
        one(0.030431812, 0.022262812, 6.5433687e-05, 0.0058864358),
        Link(
            (
                (0.039629659, (0.036124223, 0.0002809335, 2.3574439e-05)),
                (0.019611455, (0.0298 + 0.028485958, 3.9910336e-05, 0.0175 + 0.00034995059)),
            )
        ),
    ),
)

#: enactic/openarm_description, arm v10, one arm, not reflected; the tip is link8
OPENARM = Description(
    joints=(
        Joint((0, 0, 0.0625), NONE, Z, degrees(-80, 200)),
        Joint((-0.0301, 0, 0.06), (math.pi / 2, 0, 0), MINUS_X, degrees(-100, 100)),
        Joint((0.0301, 0, 0.06625), NONE, Z, degrees(-90, 90)),
        Joint((0, 0.0315, 0.15375), NONE, Y, degrees(0, 140)),
        Joint((0, -0.0315, 0.0955), NONE, Z, degrees(-90, 90)),
        Joint((0.0375, 0, 0.1205), NONE, X, degrees(-45, 45)),
        Joint((-0.0375, 0, 0), NONE, Y, degrees(-90, 90)),
    ),
    tip=(1e-06, 0.0205, 0),
    base_mm=NONE,
)

#: wuphilipp/gello_software, gello/factr/urdf/yam_active_gello/robot.urdf
GELLO_YAM = Description(
    joints=(
        Joint((-0.000235922, -0.0470799, 0.0335), (3.14159, 0, 0), Z, TURN, -1),
        Joint((-0.019, 0.015, -0.0455), (-1.5708, 0, -1.5708), Z, TURN),
        Joint((0.19825, 0, 0), (0, 0, 1.5708), Z, TURN),
        Joint((0.045, 0.18375, 0.0045), (0, 0, -3.14159), Z, TURN),
        Joint((-0.0275, -0.0555, 0.0145), (-3.14159, 1.5708, 0), Z, TURN),
        Joint((0, 0.0145, -0.0275), (1.5708, 0, 0), Z, TURN),
    ),
    tip=NONE,
    base_mm=(-0.235922, -47.0799, 0),
    links=(
        one(0.0916098, -0.000343826, 0.0147294, -0.0309321),
        one(0.120561, 0.153785, -0.000371637, 0.0187387),
        one(0.0627769, 0.0408097, 0.102486, 0.018918),
        one(0.0361067, -0.0351338, -0.0426189, 0.0145025),
        one(0.024426, 3.70677e-06, 0.00021062, -0.0194513),
        one(0.103266, -0.000787201, -0.0123456, -0.0293345),
    ),
)

DESCRIPTIONS = {
    "so101": SO101,
    "koch": KOCH,
    "vx300s": VX300S,
    "wx250s": WX250S,
    "omx": OMX,
    "omx-leader": OMX_LEADER,
    "openarm": OPENARM,
    "gello-yam": GELLO_YAM,
}
