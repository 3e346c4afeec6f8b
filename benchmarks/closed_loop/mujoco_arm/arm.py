"""Arms, drawn by seed: joints, bodies and drives that fit each other. All ranges are assumed."""

from dataclasses import dataclass, replace
from functools import cached_property

import mujoco
import numpy as np

from benchmarks.closed_loop.kinematic.machine import Encoder
from benchmarks.closed_loop.mujoco_arm.hydraulics import rods
from benchmarks.closed_loop.mujoco_arm.quantities import Cylinder, Odd, Quantities, Supply, Valve
from pipeline.machine.specification import CommandKind, JointKind, JointSpecification, MachineSpecification

RATE_HZ = 20.0
STEP_S, N_SUBSTEP = 0.0025, 2  # of the bodies, and of the drives within it
N_JOINT = (3, 7)
PRISMATIC_PROBABILITY = 0.3
INERTIA_SHARE = 0.2  # of a joint's largest inertia, that its cylinder and oil add to it
LENGTH_M, MASS_kg = (0.4, 0.9), (8.0, 40.0)  # of a link; masses fall towards the tip
RANGE_rad, RANGE_m = (1.2, 2.4), (0.3, 0.8)
SPEED_1_s = (0.18, 0.35)  # at full command, as share of the joint's range in a second
LEVER_m = (0.10, 0.20)  # of a revolute joint's cylinder, in the middle of the range
LEVER_FALLS = 0.4  # with the cosine of that share of the angle from the middle
PRESSURE_Pa, WANDER = (1.4e7, 2.1e7), (0.01, 0.03)
LOAD_SHARE, REACH_S = 0.2, 0.2  # of the set pressure: what holds the arm stretched out; what moves it so soon
STIFFNESS_Hz, DAMPING = (4.0, 8.0), (0.15, 0.4)  # of a joint on its oil, with the arm stretched out
FLOW_SHARE = (0.45, 0.8)  # of the flow of all joints at full speed, that the pump delivers
LEAKAGE_rad_s = (
    1e-4  # speed at which a sound joint that holds the arm stretched out may creep, as a share of its range
)
FRICTION_SHARE = (0.01, 0.03)  # of a cylinder's largest torque
NEVER = 1e9
NO_WEIGHT = 1e-6  # MuJoCo takes no body without


@dataclass(frozen=True)
class Link:
    """One joint and the link behind it.

    Attributes:
        joint: Name, kind and limits.
        axis: Of the joint, in the frame of the link before.
        length_m: Along that frame's x.
        mass_kg: Of a slim rod.
        lever_m: Of the cylinder in the middle of a revolute joint's range; 1 for a prismatic joint.
        friction: Coulomb friction, N m or N.
        inertia: Of cylinder and oil, kg m² or kg.
    """

    joint: JointSpecification
    axis: tuple[float, float, float]
    length_m: float
    mass_kg: float
    lever_m: float = 1.0
    friction: float = 0.0
    inertia: float = 0.0


@dataclass(frozen=True)
class Arm:
    """An arm in one state.

    Attributes:
        name: Of its specification.
        links: From the base outwards.
        quantities: Of its drives.
        payload_kg: At the tip.
        gravity_m_s2: Downwards.
    """

    name: str
    links: tuple[Link, ...]
    quantities: Quantities
    payload_kg: float = 0.0
    gravity_m_s2: float = 9.81

    def change(self, group: str, **values: np.ndarray | float) -> "Arm":
        """With other values in one group of quantities (a field of `Quantities`)."""
        changed = getattr(self.quantities, group)._replace(**values)
        return replace(self, quantities=self.quantities._replace(**{group: changed}))

    @cached_property
    def specification(self) -> MachineSpecification:
        """Names, kinds, limits and rate."""
        joints = [link.joint for link in self.links]
        return MachineSpecification(self.name, RATE_HZ, joints, CommandKind.continuous)

    @cached_property
    def transmission(self) -> np.ndarray:
        """(3, n): middle of each range, lever in the middle, and by what share of the angle from there it falls."""
        middle = 0.5 * (self.specification.lower + self.specification.upper)
        lever = [link.lever_m for link in self.links]
        falls = [LEVER_FALLS * (link.joint.kind is JointKind.revolute) for link in self.links]
        return np.array([middle, lever, falls])

    @cached_property
    def model(self) -> mujoco.MjModel:
        """Bodies in MuJoCo."""
        return mujoco.MjModel.from_xml_string(_xml(self))


def draw_arm(seed: int) -> Arm:
    """A sound arm, of which everything is drawn."""
    random = np.random.default_rng(seed)
    n = int(random.integers(N_JOINT[0], N_JOINT[1], endpoint=True))
    bare = Arm(f"arm_{seed}", _draw_links(random, n), _neutral(n))
    inertia, load = _stretched_out(bare)
    own, inertia = INERTIA_SHARE * inertia, (1.0 + INERTIA_SHARE) * inertia
    lower, upper = bare.specification.lower, bare.specification.upper
    speed = random.uniform(*SPEED_1_s, n) * (upper - lower)
    lever = np.array([link.lever_m for link in bare.links])
    pressure_Pa = random.uniform(*PRESSURE_Pa)
    area = np.maximum(load / LOAD_SHARE, inertia * speed / REACH_S / LOAD_SHARE) / (pressure_Pa * lever)
    half_stroke = rods(bare.transmission, upper)[0]
    stiffness = inertia * (2.0 * np.pi * random.uniform(*STIFFNESS_Hz, n)) ** 2 / lever**2  # N/m at the rod
    dead_volume = 0.2 * area * half_stroke
    modulus = stiffness * (dead_volume + area * half_stroke) / (2.0 * area**2)
    friction = random.uniform(*FRICTION_SHARE, n) * area * lever * pressure_Pa
    links = tuple(
        replace(link, friction=float(f), inertia=float(i))
        for link, f, i in zip(bare.links, friction, own, strict=True)
    )
    flow = area * lever * speed
    neutral, each = bare.quantities, random.uniform(0.9, 1.1, (n, 2))
    quantities = Quantities(
        neutral.valve._replace(
            dead_time_s=random.uniform(0.03, 0.12, n),
            dead_time_jitter_s=random.uniform(0.005, 0.02),
            overlap=random.uniform(0.03, 0.10, n),
            time_constant_s=random.uniform(0.04, 0.15, n),
            conductance=each * flow[:, None] / np.sqrt(0.5 * pressure_Pa),
            noise_std=random.uniform(0.01, 0.03),
            noise_correlation_s=random.uniform(0.3, 1.0),
        ),
        neutral.supply._replace(
            pressure_Pa=pressure_Pa,
            flow_m3_s=random.uniform(*FLOW_SHARE) * flow.sum(),
            gain_m3_s_Pa=flow.sum() / (0.1 * pressure_Pa),
            volume_m3=1e-3,
            modulus_Pa=modulus,
            wander_std=random.uniform(*WANDER),
            wander_correlation_s=random.uniform(10.0, 30.0),
        ),
        neutral.cylinder._replace(
            area_m2=area,
            dead_volume_m3=dead_volume,
            half_stroke_m=half_stroke,
            viscous_N_s_m=2.0 * random.uniform(*DAMPING, n) * np.sqrt(stiffness * inertia / lever**2),
            leakage_m3_s_Pa=LEAKAGE_rad_s * flow / (LOAD_SHARE * pressure_Pa),
        ),
        neutral.encoder._replace(
            jitter_s=random.uniform(0.001, 0.004), noise_std_rad=float(random.uniform(1e-4, 3e-4))
        ),
        neutral.odd,
    )
    return replace(bare, links=links, quantities=quantities)


def _draw_links(random: np.random.Generator, n: int) -> tuple[Link, ...]:
    links = []
    for k in range(n):
        is_prismatic = k > 0 and random.random() < PRISMATIC_PROBABILITY
        share = 0.75**k
        if is_prismatic:
            span, middle, axis = random.uniform(*RANGE_m), 0.0, (1.0, 0.0, 0.0)
        else:
            span, middle = random.uniform(*RANGE_rad), random.uniform(-0.4, 0.4)
            axis = ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0))[int(random.random() < (0.7 if k == 0 else 0.2))]
        kind = JointKind.prismatic if is_prismatic else JointKind.revolute
        joint = JointSpecification(
            f"joint_{k + 1}", round(middle - 0.5 * span, 3), round(middle + 0.5 * span, 3), kind
        )
        lever = 1.0 if is_prismatic else random.uniform(*LEVER_m)
        mass = share * random.uniform(*MASS_kg)
        links.append(Link(joint, axis, random.uniform(*LENGTH_M), mass, float(lever)))
    return tuple(links)


def _neutral(n: int) -> Quantities:
    """Drives in which nothing that only effects change has a part; what is drawn is zero."""
    zeros, sides = np.zeros(n), np.zeros((n, 2))
    return Quantities(
        Valve(zeros, 0.0, zeros, zeros, sides, 0.0, 1.0, zeros, zeros),
        Supply(0.0, 0.0, 0.0, 0.0, zeros, 0.0, 1.0, 0.0, 1.0),
        Cylinder(zeros, zeros, zeros, zeros, zeros, zeros, sides, np.ones((n, 2))),
        Encoder(0.02, 0.0, 0.0, 1e-5, zeros, np.ones(n), 0.0, 0.0),
        Odd(
            pull=np.zeros((n, n)),
            hold_boost=zeros,
            hold_s=NEVER,
            lockout_s=zeros,
            heat_loss=zeros,
            heat_s=1.0,
            kink_loss=np.zeros((n, n)),
            kink_at=np.full(n, NEVER),
            block_loss=zeros,
            block_share=0.0,
            block_s=1.0,
            timer_loss=zeros,
            timer_s=1.0,
        ),
    )


def _stretched_out(arm: Arm) -> tuple[np.ndarray, np.ndarray]:
    """Inertia seen by each joint and what gravity asks of it at most, (n,) each, over the corners of the range.

    The corners are those of all joints at their lower, middle or upper places together.
    """
    model = arm.model
    data, n = mujoco.MjData(model), model.nv
    inertia, load, full = np.zeros(n), np.zeros(n), np.zeros((n, n))
    for share in (0.0, 0.25, 0.5, 0.75, 1.0):
        data.qpos[:] = arm.specification.lower + share * (arm.specification.upper - arm.specification.lower)
        data.qvel[:] = 0.0
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, full)
        inertia, load = np.maximum(inertia, np.diag(full)), np.maximum(load, np.abs(data.qfrc_bias))
    return inertia, load


def _xml(arm: Arm) -> str:
    """Slim rods along x behind one another, without contacts."""
    opened, tip = [], 0.0
    for link in arm.links:
        kind = "slide" if link.joint.kind is JointKind.prismatic else "hinge"
        r = 0.05
        across = link.mass_kg * (link.length_m**2 / 12.0 + r**2 / 4.0)
        opened.append(
            f'<body pos="{tip} 0 0"><joint name="{link.joint.name}" type="{kind}" '
            f'axis="{link.axis[0]} {link.axis[1]} {link.axis[2]}" limited="true" '
            f'range="{link.joint.lower} {link.joint.upper}" frictionloss="{link.friction}" armature="{link.inertia}"/>'
            f'<inertial pos="{0.5 * link.length_m} 0 0" mass="{link.mass_kg}" '
            f'diaginertia="{0.5 * link.mass_kg * r**2} {across} {across}"/>'
        )
        tip = link.length_m
    weight = f'mass="{arm.payload_kg + NO_WEIGHT}" diaginertia="{NO_WEIGHT} {NO_WEIGHT} {NO_WEIGHT}"'
    payload = f'<body pos="{tip} 0 0"><inertial pos="0 0 0" {weight}/></body>'
    return (
        f'<mujoco><compiler angle="radian"/><option timestep="{STEP_S}" gravity="0 0 {-arm.gravity_m_s2}" '
        'integrator="implicitfast"><flag contact="disable"/></option>'
        f"<worldbody>{''.join(opened)}{payload}{'</body>' * len(arm.links)}</worldbody></mujoco>"
    )
