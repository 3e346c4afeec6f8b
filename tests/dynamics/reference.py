"""The paper's equations in float64 NumPy, written with its absolute time indices and no shared code.

Rows: q[t], qd[t], a[t]. One scalar loop per index, so that every index can be read against the paper.
"""

import numpy as np
from numpy.polynomial import legendre


def min_max(value, lower, upper):
    """Eq. min_max_normalization, one joint."""
    return 2.0 * (value - lower) / (upper - lower) - 1.0


def approximate_state(specification, motion, commands, q):
    """Eqs. x_t_pos and x_t_vel: lists of k+1 rows each, oldest first, and the current configuration."""
    joints = range(len(specification.joints))
    lower, upper = specification.position_lower, specification.position_upper
    x = []
    for row in motion:
        for j in joints:
            if specification.target == "dq":
                x.append(min_max(row[j], lower[j], upper[j]))
            else:
                limit = specification.velocity_limit[j]
                x.append(min_max(row[j], -limit, limit))
    for row in commands:
        x.extend(row[j] for j in joints)
    x.extend(min_max(q[j], lower[j], upper[j]) for j in joints)
    return np.array(x)


def network(specification, parameters, x):
    """f: SiLU layers with linear output, or Legendre layers of tanh."""
    layers = [
        {name: np.asarray(value, np.float64) for name, value in parameters[f"layer_{index}"].items()}
        for index in range(len(specification.hidden) + 1)
    ]
    for index, layer in enumerate(layers):
        if specification.parameterization == "mlp":
            if index > 0:
                x = x / (1.0 + np.exp(-x))
            x = x @ layer["kernel"] + layer["bias"]
        else:
            y = layer["bias"].copy()
            for output in range(len(y)):
                for input_ in range(len(x)):
                    coefficients = np.concatenate([[0.0], layer["c_basis"][output, input_]])
                    y[output] += legendre.legval(np.tanh(x[input_]), coefficients)
            x = y
    return np.asarray(specification.residual_scale) * x


def rollout(specification, parameters, q, qd, a, t, horizon, has_stops=False):
    """q̂_{t+1} … q̂_{t+H} from measured rows up to t and commands a_t … a_{t+H-1}.

    With stops positions end at the limits, or at the furthest that they have been beyond until t.
    """
    k, dt = specification.lags, 1.0 / specification.rate_hz
    known = np.array(q[: t + 1])
    lower = np.minimum(specification.position_lower, known.min(axis=0)) if has_stops else -np.inf
    upper = np.maximum(specification.position_upper, known.max(axis=0)) if has_stops else np.inf
    position = {s: np.array(q[s]) for s in range(t - k, t + 1)}
    velocity = {s: np.array(qd[s]) for s in range(t - k, t + 1)}
    for s in range(t, t + horizon):
        motion = position if specification.target == "dq" else velocity
        x = approximate_state(
            specification,
            [motion[i] for i in range(s - k, s + 1)],
            [a[i] for i in range(s - k, s + 1)],
            position[s],
        )
        f = network(specification, parameters, x)
        if specification.target == "dq":
            position[s + 1] = np.clip(position[s] + f, lower, upper)
        else:
            velocity[s + 1] = velocity[s] + f
            position[s + 1] = np.clip(position[s] + dt * velocity[s + 1], lower, upper)
    return np.stack([position[s] for s in range(t + 1, t + horizon + 1)])
