"""Hydraulic oil: viscosity over temperature, effective bulk modulus, heat balance."""

import numpy as np

from pipeline.plant.compiled import compiled
from pipeline.plant.parameters import Oil

ZERO_CELSIUS_K = 273.15
ATMOSPHERE_PA = 101_325.0
CST = 1.0e-6  # m2/s


@compiled
def dynamic_viscosity(oil: Oil, temperature_C: float) -> float:
    """Dynamic viscosity, Pa s, by the Walther equation of ASTM D341 (pressure dependence left out)."""
    double_log = oil.walther_a - oil.walther_b * np.log10(temperature_C + ZERO_CELSIUS_K)
    return (10.0 ** (10.0**double_log) - 0.7) * CST * oil.density_kg_m3


@compiled
def effective_bulk_modulus(
    oil_modulus_Pa: float, hose_modulus_Pa: float, air_fraction: float, gauge_Pa: float
) -> float:
    """Bulk modulus of oil with entrained air in an elastic line, Pa.

    1/β = 1/β_oil + 1/β_hose + x p₀/p² with isothermal air (Merritt, section 2-4; Jelali & Kroll,
    section 2.3).
    """
    absolute = max(gauge_Pa, 0.0) + ATMOSPHERE_PA
    return 1.0 / (1.0 / oil_modulus_Pa + 1.0 / hose_modulus_Pa + air_fraction * ATMOSPHERE_PA / absolute**2)


@compiled
def warmed(oil: Oil, temperature_C: float, heat_J: float, duration_s: float) -> float:
    """Temperature after `duration_s` in which `heat_J` was dissipated: one lumped heat capacity."""
    loss_W = oil.heat_loss_W_K * (temperature_C - oil.ambient_C)
    return temperature_C + (heat_J - loss_W * duration_s) / oil.heat_capacity_J_K
