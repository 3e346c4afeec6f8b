"""Machine variants: other machines of the same build, drawn by seed within stated tolerances.

Manufacturing, wear and setting differ from machine to machine; geometry and joint limits do not. Tolerances
are assumed: metering edges and set-points a few percent (usual for cast spools set by hand), pilot dynamics
and friction more.
"""

import numpy as np

from pipeline.plant.parameters import Parameters

# relative standard deviations; factors are drawn log-normal
METERING = 0.05
PUMP_FLOW = 0.03
PRESSURE_SETTING = 0.03
PILOT_DYNAMICS = 0.12
OVERLAP = 0.10
FRICTION = 0.15
AIR = 0.30
MASS = 0.02
HEAT = 0.15
START_STD_C = 3.0  # of the oil's start temperature


def draw_variant(parameters: Parameters, seed: int) -> Parameters:
    """A machine like `parameters`, with its own tolerances."""
    random = np.random.default_rng(seed)

    def varied(value: np.ndarray, tolerance: float) -> np.ndarray:
        return value * np.exp(tolerance * random.standard_normal(np.shape(value)))

    pilot, spool, supply = parameters.pilot, parameters.spool, parameters.supply
    friction, links, oil = parameters.friction, parameters.links, parameters.oil
    return parameters._replace(
        pilot=pilot._replace(
            dead_time_s=varied(pilot.dead_time_s, PILOT_DYNAMICS),
            rise_time_constant_s=varied(pilot.rise_time_constant_s, PILOT_DYNAMICS),
            fall_time_constant_s=varied(pilot.fall_time_constant_s, PILOT_DYNAMICS),
        ),
        spool=spool._replace(
            inlet_area_m2=varied(spool.inlet_area_m2, METERING),
            outlet_area_m2=varied(spool.outlet_area_m2, METERING),
            overlap=varied(spool.overlap, OVERLAP),
        ),
        supply=supply._replace(
            pump_flow_m3_s=float(varied(np.array(supply.pump_flow_m3_s), PUMP_FLOW)),
            relief_pressure_Pa=float(varied(np.array(supply.relief_pressure_Pa), PRESSURE_SETTING)),
        ),
        friction=friction._replace(
            coulomb_N=varied(friction.coulomb_N, FRICTION),
            viscous_N_s_m=varied(friction.viscous_N_s_m, FRICTION),
            pin_Nm=varied(friction.pin_Nm, FRICTION),
        ),
        links=links._replace(mass_kg=varied(links.mass_kg, MASS)),
        oil=oil._replace(
            air_fraction=varied(oil.air_fraction, AIR),
            heat_loss_W_K=float(varied(np.array(oil.heat_loss_W_K), HEAT)),
            start_C=oil.start_C + START_STD_C * float(random.standard_normal()),
        ),
    )
