import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.machine.specification import CommandKind
from pipeline.reaching.discretise import command_from_proto_action, discretise


def test_boundaries_belong_to_zero():
    proto = jnp.array([-1.0, -0.5000001, -0.5, 0.0, 0.5, 0.5000001, 1.0])
    np.testing.assert_array_equal(discretise(proto), [-1, -1, 0, 0, 0, 1, 1])


@settings(deadline=None)
@given(st.lists(st.floats(-1, 1, width=32), min_size=4, max_size=4))
def test_is_the_equation_component_by_component(proto):
    expected = [-1 if x < -0.5 else (1 if x > 0.5 else 0) for x in proto]
    np.testing.assert_array_equal(discretise(jnp.asarray(proto, jnp.float32)), expected)


def test_continuous_machines_are_only_clipped():
    proto = jnp.array([-1.5, -0.3, 0.2, 7.0])
    np.testing.assert_allclose(
        command_from_proto_action(CommandKind.continuous, proto), [-1.0, -0.3, 0.2, 1.0]
    )
    np.testing.assert_array_equal(command_from_proto_action(CommandKind.discrete, proto), [-1, 0, 0, 1])


def test_is_a_pure_function_of_any_leading_axes():
    proto = jnp.linspace(-1, 1, 24).reshape(2, 3, 4)
    np.testing.assert_array_equal(jax.jit(jax.vmap(discretise))(proto), discretise(proto))
