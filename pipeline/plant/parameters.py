"""Every physical quantity of the simulated machine, with its unit.

Named tuples: the compiled inner loop takes them as they are, and a change of a quantity (an effect, a
machine variant) is a `_replace`. `bobcat_e10.py` holds values and their sources.

Shapes: `(n,)` one value per joint in the machine's joint order, `(n, 2)` one per joint and direction of
motion, index 0 for the negative and 1 for the positive direction of the joint. Each cylinder has two
chambers; chamber `[j, 1]` is the one whose pressure drives joint j in its positive direction, whichever
side of the piston that is.

Sources used throughout the package:

- Merritt, H. E.: Hydraulic Control Systems. Wiley, 1967.
- Jelali, M.; Kroll, A.: Hydraulic Servo-systems. Springer, 2003.
- Armstrong-Hélouvry, B.; Dupont, P.; Canudas de Wit, C.: A survey of models, analysis tools and
  compensation methods for the control of machines with friction. Automatica 30(7), 1994.
"""

from typing import NamedTuple

import numpy as np

FloatArray = np.ndarray

NEGATIVE, POSITIVE = 0, 1
"""Indices of the two directions of motion in arrays of shape (n, 2)."""


class Pilot(NamedTuple):
    """Electro-hydraulic pilot stage: controller cycle, electro-valve, pilot hose (one per direction)."""

    controller_cycle_s: float
    """The controller reads commands once per cycle, at a random phase."""
    dead_time_s: FloatArray
    """(n, 2) Bus, solenoid current rise and hose transport."""
    set_pressure_Pa: FloatArray
    """(n, 2) Pilot pressure that the discrete command's current set-point asks for."""
    rise_time_constant_s: FloatArray
    """(n, 2) First-order build-up of pilot pressure, at the reference viscosity."""
    fall_time_constant_s: FloatArray
    """(n, 2) First-order decay of pilot pressure, at the reference viscosity."""
    viscous_share: float
    """1. Share of the time constants that is laminar hose flow, proportional to viscosity."""
    noise_std: float
    """1. Relative standard deviation of pilot pressure: dither, pump ripple."""
    noise_correlation_s: float
    """Correlation time of that noise."""
    crosstalk: FloatArray
    """(n, 2, n, 2) At [i, e, j, d]: share of pilot pressure [j, d] that leaks into pilot line [i, e]."""
    coil_fade: FloatArray
    """(n, 2) Relative loss of pilot pressure of a coil that is warm from being held on."""
    coil_time_constant_s: float
    """Warming and cooling of the coil."""
    supply_sag: float
    """1. Relative loss of pilot pressure when all pilots have lately been active."""
    supply_time_constant_s: float
    """Time constant of that average of recent activity."""
    late_interval_s: float
    """Mean time until commands stop coming through; infinity: they always do. The controller repeats the last one."""
    late_s: float
    """Mean time until they come through again."""


class Spool(NamedTuple):
    """Main spools: from pilot pressure to metering areas."""

    preload_Pa: float
    """Pilot pressure at which the centring spring starts to give."""
    full_stroke_Pa: float
    """Pilot pressure at full stroke."""
    overlap: FloatArray
    """(n, 2) Share of the stroke before the metering edge opens."""
    time_constant_s: float
    """Spool motion in its damping oil."""
    hysteresis: float
    """1. Width of the band, in strokes, in which spool friction holds the spool."""
    silt_pressure_Pa: FloatArray
    """(n,) Pilot pressure that a spool locked by silt withstands after long rest."""
    silt_time_constant_s: float
    """Growth of the silt lock with rest."""
    silt_spread: float
    """1. Relative standard deviation of the lock from one activation to the next."""
    inlet_area_m2: FloatArray
    """(n, 2) Supply to chamber, at full stroke towards that direction."""
    outlet_area_m2: FloatArray
    """(n, 2) Opposite chamber to tank, at full stroke towards that direction."""
    notch_exponent: float
    """1. Area grows with opening to this power."""
    bypass_open_area_m2: float
    """Open centre: area of one section's bypass in neutral."""
    bypass_closed_area_m2: float
    """What is left of it once the spool is out."""
    bypass_close_stroke: float
    """1. Stroke at which the bypass has closed that far."""
    discharge_coefficient: float
    """1. Of all sharp-edged orifices."""


class Supply(NamedTuple):
    """Engine, pump, relief valve and return line."""

    pump_flow_m3_s: float
    """Flow of the fixed-displacement pump at rated engine speed, without leakage."""
    pump_leakage_m3: float
    """Laminar slip: flow = this * pressure / dynamic viscosity (unit m3)."""
    relief_pressure_Pa: float
    """Cracking pressure of the main relief valve."""
    relief_gain_m3_s_Pa: float
    """Its flow per pressure above cracking."""
    volume_m3: float
    """Oil between pump and spools."""
    hose_modulus_Pa: float
    """Equivalent bulk modulus of the elastic line between them."""
    return_pressure_Pa: float
    """Back pressure of return line and filter."""
    engine_droop: float
    """1. Relative loss of engine speed at rated power."""
    engine_power_W: float
    """Rated power."""
    engine_time_constant_s: float
    """Governor."""
    ripple_std: float
    """1. Relative standard deviation of engine speed."""
    ripple_correlation_s: float
    """Correlation time of it."""
    relief_wander_std: float
    """1. Relative standard deviation of the relief valve's setting."""
    others_share: float
    """1. Share of the pump's flow that other functions take while they run."""
    others_interval_s: float
    """Mean time until other functions start; infinity: they never do."""
    others_s: float
    """Mean time that they run."""


class Cylinder(NamedTuple):
    """The four cylinders with their work lines."""

    area_m2: FloatArray
    """(n, 2) Piston area of the chamber that drives that direction."""
    dead_volume_m3: FloatArray
    """(n, 2) Hose and end-of-stroke volume."""
    line_resistance_Pa_s_m3: FloatArray
    """(n,) Laminar resistance of one work line at the reference viscosity."""
    line_clogging_per_m3: FloatArray
    """(n,) Relative growth of that resistance per volume passed."""
    kink_source: FloatArray
    """(n,) Index of the joint whose position kinks the hose, -1 for none."""
    kink_onset_rad: FloatArray
    """(n,) Position at which the kink begins."""
    kink_side: FloatArray
    """(n,) +1: beyond the onset upwards, -1: downwards."""
    kink_resistance_Pa_s_m3_rad: FloatArray
    """(n,) Added resistance per radian beyond the onset."""
    cross_leakage_m3: FloatArray
    """(n,) Laminar leak past the piston: flow = this * pressure difference / dynamic viscosity."""
    tank_leakage_m3: FloatArray
    """(n, 2) Laminar leak past the closed spool to tank: flow = this * pressure / dynamic viscosity."""
    port_relief_Pa: float
    """Anti-shock valve of each chamber."""
    make_up_gain_m3_s_Pa: float
    """Anti-cavitation check valve of each chamber, flow per pressure below the return line's."""
    cushion_zone_rad: FloatArray
    """(n, 2) Length of the cushioned zone before the limit in that direction."""
    cushion_area_m2: FloatArray
    """(n, 2) Outlet area that the cushion leaves at the limit."""
    cushion_open_area_m2: float
    """Outlet area of the cushion at the zone's beginning."""


class Linkage(NamedTuple):
    """Joint angle to cylinder travel, tabulated by `linkage.py` over each joint's range."""

    lower_rad: FloatArray
    """(n,) Lower mechanical stop."""
    upper_rad: FloatArray
    """(n,) Upper mechanical stop."""
    moment_arm_m: FloatArray
    """(n, m) |d(cylinder length)/d(joint angle)| on an even grid from lower to upper stop."""
    travel_m: FloatArray
    """(n, m) Its integral from the lower stop."""
    play_rad: FloatArray
    """(n,) Pin clearance between cylinder drive and link, in joint angle."""


class Links(NamedTuple):
    """Rigid bodies: turret (swing column) and the planar chain boom, arm, hammer.

    Joint order is swing, boom, arm, bucket; the chain's arrays have shape (3,).
    """

    turret_inertia_kg_m2: float
    """About the swing axis, with cylinders and valve block that swing along."""
    mass_kg: FloatArray
    """(3,)"""
    length_m: FloatArray
    """(3,) Pivot to pivot; the last to the chisel's tip."""
    centre_m: FloatArray
    """(3, 2) Pivot to centre of mass: along the link, and across it (upwards at zero angle)."""
    inertia_kg_m2: FloatArray
    """(3,) About the centre of mass, transverse."""
    pivot_radius_m: float
    """Boom pivot from the swing axis."""
    payload_kg: float
    """Point mass hanging at the chisel's tip."""
    gravity_m_s2: float
    """Standard gravity."""


class Contact(NamedTuple):
    """What the chisel's tip meets: the ground, and the base as an upright cylinder about the swing axis.

    Heights are above the origin of {B}.
    """

    floor_m: float
    """Height of the ground, or of a grill on it; minus infinity: there is none."""
    pivot_height_m: float
    """Height of the boom pivot."""
    base_radius_m: float
    """Radius of the base; zero: there is none."""
    base_height_m: float
    """Height of the base."""


class Friction(NamedTuple):
    """Seals and pins."""

    coulomb_N: FloatArray
    """(n,) Seal friction of the moving cylinder."""
    static_ratio: FloatArray
    """(n,) Breakaway over Coulomb friction."""
    stribeck_speed_m_s: float
    """Piston speed at which the excess has decayed to 1/e."""
    viscous_N_s_m: FloatArray
    """(n,) At the reference viscosity."""
    pin_Nm: FloatArray
    """(n,) Coulomb torque of pins and swing bearing."""


class Oil(NamedTuple):
    """Hydraulic oil and its heat balance."""

    density_kg_m3: float
    """At working temperature."""
    bulk_modulus_Pa: float
    """Of the oil without air."""
    hose_modulus_Pa: FloatArray
    """(n,) Equivalent bulk modulus of the elastic work lines."""
    air_fraction: FloatArray
    """(n,) Entrained air by volume at atmospheric pressure."""
    walther_a: float
    """Walther equation (ASTM D341): log10 log10(nu/cSt + 0.7) = a - b log10(T/K)."""
    walther_b: float
    """See `walther_a`."""
    reference_viscosity_Pa_s: float
    """Dynamic viscosity at which viscous quantities are stated."""
    heat_capacity_J_K: float
    """Oil, tank and metal that warm up together."""
    heat_loss_W_K: float
    """To the ambience."""
    ambient_C: float
    """Temperature around the machine."""
    start_C: float
    """Oil temperature when the session starts."""


class Sensor(NamedTuple):
    """Encoders, and the way of their readings into the log."""

    noise_std_rad: float
    """Before quantisation."""
    quantum_rad: float
    """One count."""
    offset_rad: FloatArray
    """(n,)"""
    scale: FloatArray
    """(n,) Reading per angle, about zero."""
    period_s: float
    """Between joint states."""
    stamp_jitter_s: float
    """Half width of the uniform jitter of sample times."""
    stamp_lateness_s: float
    """Age of a reading when it gets its stamp."""
    publication_delay_s: tuple[float, float]
    """Least and largest time from stamp to log, uniform."""
    drop_probability: float
    """1. Joint states that never reach the log."""
    command_jitter_s: float
    """Half width of the uniform jitter of command times."""
    mount_flex_rad: FloatArray
    """(n,) Band within which the encoder's mount gives way to the friction of its shaft."""


class Numerics(NamedTuple):
    """How the equations are solved."""

    substep_s: float
    """Step of the semi-implicit integration."""
    control_period_s: float
    """Commands come once per period."""
    trace_stride: int
    """Substeps between two stored configurations, from which encoder readings are interpolated."""


class Parameters(NamedTuple):
    """A whole machine."""

    pilot: Pilot
    spool: Spool
    supply: Supply
    cylinder: Cylinder
    linkage: Linkage
    links: Links
    contact: Contact
    friction: Friction
    oil: Oil
    sensor: Sensor
    numerics: Numerics

    def change(self, part: str, **quantities: object) -> "Parameters":
        """A copy in which `quantities` of one part (`pilot`, `spool`, …) have new values."""
        return self._replace(**{part: getattr(self, part)._replace(**quantities)})


def filled(n_joint: int, value: float) -> np.ndarray:
    """An array (n_joint,) of one value."""
    return np.full(n_joint, value, dtype=np.float64)
