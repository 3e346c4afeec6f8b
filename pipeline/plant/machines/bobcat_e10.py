"""Values of the simulated Bobcat E10 with hydraulic impact hammer.

No maker's data of cylinders and valve block is public in the needed detail, so most values are assumed: of
the order that textbooks and data sheets give for 1.1 t machines, and then adjusted within that order until
full-command speeds and rise times are those of the contract (section 1: 0.25-0.7 rad/s, 0.4-1.0 s).
Geometry and joint limits are the contract's. Link masses are those of `conf/machine/bobcat_e10.urdf`
(assumed there). Everything not marked otherwise is assumed.
"""

import numpy as np

from pipeline.plant.parameters import (
    Contact,
    Cylinder,
    Friction,
    Linkage,
    Links,
    Numerics,
    Oil,
    Parameters,
    Pilot,
    Sensor,
    Spool,
    Supply,
    filled,
)
from pipeline.plant.physics import linkage

JOINT_NAMES = ("swing", "boom", "arm", "bucket")
N_JOINT = len(JOINT_NAMES)

BAR = 1.0e5  # Pa
LITRE_PER_MINUTE = 1.0e-3 / 60.0  # m3/s
MM2 = 1.0e-6  # m2

LOWER_RAD = np.array([-0.9, -0.6, -2.4, -2.2])  # contract, section 1
UPPER_RAD = np.array([0.9, 1.2, -0.3, 0.5])  # contract, section 1

GEOMETRY: tuple[linkage.CylinderGeometry, ...] = (
    # Pins such that closed length exceeds stroke by piston and eyes (>= 0.12 m), far from dead centres.
    linkage.Triangle(fixed_m=0.50, moving_m=0.16, angle_at_zero_rad=1.45, sign=1.0),
    linkage.Triangle(fixed_m=0.25, moving_m=0.75, angle_at_zero_rad=1.10, sign=1.0),
    linkage.Triangle(fixed_m=0.85, moving_m=0.19, angle_at_zero_rad=0.15, sign=-1.0),
    # Found by random search for an even moment arm over 2.7 rad.
    linkage.FourBar(
        rocker_pivot_m=0.106,
        rocker_m=0.238,
        coupler_m=0.180,
        crank_m=0.107,
        crank_angle_at_zero_rad=1.542,
        cylinder_base_m=0.534,
        cylinder_base_angle_rad=2.792,
    ),
)


def bore_area_m2(diameter_m: float) -> float:
    """Area of a full circle."""
    return 0.25 * np.pi * diameter_m**2


# Bore and rod, m: metric series of ISO 3320, sizes usual in the 1 t class.
BORE_M = np.array([0.050, 0.050, 0.045, 0.040])
ROD_M = np.array([0.028, 0.028, 0.025, 0.025])
EXTENDS_POSITIVE = np.array([True, True, False, False])  # arm out and hammer out retract their cylinders


def bobcat_e10() -> Parameters:
    """The nominal machine, joint order swing, boom, arm, bucket."""
    n_grid = 541
    tables = [
        linkage.tabulate(g, lo, up, n_grid) for g, lo, up in zip(GEOMETRY, LOWER_RAD, UPPER_RAD, strict=True)
    ]
    full = bore_area_m2(1.0) * BORE_M**2
    annulus = full - bore_area_m2(1.0) * ROD_M**2
    areas = np.stack(
        [np.where(EXTENDS_POSITIVE, annulus, full), np.where(EXTENDS_POSITIVE, full, annulus)], axis=-1
    )
    return Parameters(
        pilot=Pilot(
            controller_cycle_s=0.010,  # usual cycle of mobile controllers
            dead_time_s=np.array([[0.13, 0.13], [0.12, 0.14], [0.12, 0.13], [0.11, 0.11]]),
            set_pressure_Pa=np.full((N_JOINT, 2), 18.0 * BAR),  # pilot systems: 0-30 bar
            rise_time_constant_s=np.array([[0.30, 0.28], [0.27, 0.32], [0.27, 0.30], [0.24, 0.26]]),
            fall_time_constant_s=np.array([[0.14, 0.14], [0.13, 0.14], [0.13, 0.13], [0.12, 0.12]]),
            viscous_share=0.3,
            noise_std=0.020,
            noise_correlation_s=0.4,
            crosstalk=np.zeros((N_JOINT, 2, N_JOINT, 2)),
            coil_fade=np.zeros((N_JOINT, 2)),  # neutral: current-controlled outputs
            coil_time_constant_s=4.0,
            supply_sag=0.0,  # neutral: pilot pump never falls short
            supply_time_constant_s=30.0,
            late_interval_s=np.inf,  # neutral: every command comes through
            late_s=0.1,
        ),
        spool=Spool(
            preload_Pa=5.0 * BAR,  # spools start to move at 5-6 bar in usual pilot systems
            full_stroke_Pa=24.0 * BAR,
            overlap=np.array([[0.10, 0.10], [0.10, 0.12], [0.11, 0.10], [0.10, 0.10]]),
            time_constant_s=0.015,
            hysteresis=0.02,  # 2-4 % of stroke (Jelali & Kroll, section 3.3)
            silt_pressure_Pa=filled(N_JOINT, 0.6 * BAR),
            silt_time_constant_s=2.0,
            silt_spread=0.3,
            inlet_area_m2=np.array([[1.8, 2.2], [2.9, 5.0], [2.1, 2.2], [1.10, 0.80]]) * MM2,
            outlet_area_m2=np.array([[2.4, 2.0], [4.0, 5.0], [2.2, 2.9], [1.3, 1.35]]) * MM2,
            notch_exponent=1.2,
            bypass_open_area_m2=40.0 * MM2,
            bypass_closed_area_m2=2.2 * MM2,
            bypass_close_stroke=0.45,
            discharge_coefficient=0.67,  # Merritt, section 3-2: sharp-edged orifices 0.60-0.70
        ),
        supply=Supply(
            pump_flow_m3_s=21.0 * LITRE_PER_MINUTE,
            pump_leakage_m3=6.0e-14,  # volumetric efficiency about 0.95 at 100 bar warm
            relief_pressure_Pa=180.0 * BAR,
            relief_gain_m3_s_Pa=21.0 * LITRE_PER_MINUTE / (12.0 * BAR),
            volume_m3=0.7e-3,
            hose_modulus_Pa=2.0e9,
            return_pressure_Pa=3.0 * BAR,
            engine_droop=0.05,  # mechanical governors: 5-8 %
            engine_power_W=7.4e3,
            engine_time_constant_s=0.25,
            ripple_std=0.012,
            ripple_correlation_s=6.0,
            relief_wander_std=0.0,
            others_share=0.0,  # neutral: nothing else is fed
            others_interval_s=np.inf,
            others_s=1.0,
        ),
        cylinder=Cylinder(
            area_m2=areas,
            dead_volume_m3=np.full((N_JOINT, 2), 1.2e-4),  # 2 m hose of 8 mm and the piston's end volume
            line_resistance_Pa_s_m3=filled(N_JOINT, 1.2e9),  # Hagen-Poiseuille, 2 m of 8 mm bore at 40 mPa s
            line_clogging_per_m3=filled(N_JOINT, 0.0),
            kink_source=filled(N_JOINT, -1.0),
            kink_onset_rad=filled(N_JOINT, 0.0),
            kink_side=filled(N_JOINT, 1.0),
            kink_resistance_Pa_s_m3_rad=filled(N_JOINT, 0.0),
            cross_leakage_m3=filled(N_JOINT, 2.0e-16),
            tank_leakage_m3=np.full((N_JOINT, 2), 2.0e-16),
            port_relief_Pa=220.0 * BAR,
            make_up_gain_m3_s_Pa=1.0e-9,
            cushion_zone_rad=np.full((N_JOINT, 2), 0.04),
            cushion_area_m2=np.full((N_JOINT, 2), 0.5 * MM2),
            cushion_open_area_m2=30.0 * MM2,
        ),
        linkage=Linkage(
            lower_rad=LOWER_RAD.copy(),
            upper_rad=UPPER_RAD.copy(),
            moment_arm_m=np.stack([arm for arm, _ in tables]),
            travel_m=np.stack([travel for _, travel in tables]),
            play_rad=filled(N_JOINT, 0.0006),
        ),
        links=Links(
            turret_inertia_kg_m2=1.4,  # URDF: 60 kg swing column, 0.76 kg m2, centre 0.10 m from the axis
            mass_kg=np.array([45.0, 22.0, 55.0]),
            length_m=np.array([1.35, 0.80, 0.65]),  # contract, section 1
            centre_m=np.array([[0.62, 0.10], [0.30, 0.03], [0.28, 0.0]]),  # URDF
            inertia_kg_m2=np.array([6.98, 1.87, 1.50]),  # URDF
            pivot_radius_m=0.25,  # contract, section 1
            payload_kg=0.0,
            gravity_m_s2=9.80665,
        ),
        contact=Contact(
            floor_m=0.0,  # the origin of {B} is on the ground (URDF)
            pivot_height_m=0.50,  # contract, section 1
            base_radius_m=0.32,  # URDF: front of the swing column's foot, from the swing axis
            base_height_m=0.60,  # URDF: top of the swing column
        ),
        friction=Friction(
            coulomb_N=np.array([250.0, 300.0, 250.0, 200.0]),  # 2-4 % of the force at 100 bar
            static_ratio=filled(N_JOINT, 1.4),
            stribeck_speed_m_s=0.01,
            viscous_N_s_m=np.array([4.0e3, 4.0e3, 3.0e3, 3.0e3]),
            pin_Nm=np.array([40.0, 20.0, 15.0, 8.0]),
        ),
        oil=Oil(
            density_kg_m3=870.0,
            bulk_modulus_Pa=1.5e9,  # Merritt, section 2-4, mineral oil
            hose_modulus_Pa=filled(N_JOINT, 2.0e9),
            air_fraction=filled(N_JOINT, 0.005),
            # ISO VG 46, viscosity index 100: 46 cSt at 40 °C, 6.8 cSt at 100 °C
            walther_a=9.418,
            walther_b=3.6844,
            reference_viscosity_Pa_s=0.030,
            heat_capacity_J_K=5.0e4,  # 12 l oil and 60 kg steel
            heat_loss_W_K=45.0,
            ambient_C=15.0,
            start_C=54.0,
        ),
        sensor=Sensor(
            noise_std_rad=4.0e-4,  # about the rest noise of the practice logs
            quantum_rad=2.0 * np.pi / 8192.0,  # 13 bit, the quantum of the practice logs
            offset_rad=filled(N_JOINT, 0.0),
            scale=filled(N_JOINT, 1.0),
            period_s=0.020,  # 50 Hz, as in the practice logs, and so are the next values
            stamp_jitter_s=0.002,
            stamp_lateness_s=0.0,
            publication_delay_s=(0.0008, 0.0028),
            drop_probability=0.0,
            command_jitter_s=0.003,
            mount_flex_rad=filled(N_JOINT, 0.0),  # neutral: rigid mounts
        ),
        numerics=Numerics(substep_s=0.001, control_period_s=0.050, trace_stride=5),
    )
