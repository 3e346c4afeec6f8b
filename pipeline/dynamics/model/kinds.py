"""Which class a specification makes a model of."""

from collections.abc import Mapping
from typing import Any

from pipeline.dynamics.model.dynamics_model import DynamicsModel
from pipeline.dynamics.model.fir.model import FirModel
from pipeline.dynamics.model.fir.specification import FirSpecification
from pipeline.dynamics.model.network import Parameterization
from pipeline.dynamics.model.specification import ModelSpecification


def build_model(specification: ModelSpecification) -> DynamicsModel:
    """The model of this specification."""
    if isinstance(specification, FirSpecification):
        return FirModel(specification)
    return DynamicsModel(specification)


def read_specification(content: Mapping[str, Any]) -> ModelSpecification:
    """The specification of its fields.

    Raises:
        TypeError: A field is missing, or none of a specification.
        InputError: A value is impossible.
    """
    is_fir = content.get("parameterization") == Parameterization.nfir
    return (FirSpecification if is_fir else ModelSpecification)(**content)
