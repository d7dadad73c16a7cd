"""The real tasks' dynamics, compiled: classic control as in gymnasium
(`gymnasium/envs/classic_control`); the tests compare both over whole episodes.

symbol    shape          meaning
-------   ------------   ----------------------------------------------------
physics   (p,) float64   the simulator's state (CartPole: x, dx, angle, spin;
                         Acrobot: angle1, angle2, spin1, spin2;
                         both MountainCars: x, dx; Pendulum: angle, spin)
state     (S,) float32   what the agent observes
action    float          an index from 0, or a value in [-1, 1]
"""

import math

import numpy as np

from bilevel.kernels.jit import compiled

#: Codes of the dynamics. OBSERVED is an environment that gymnasium runs; its physics are
#: observations.
OBSERVED, CARTPOLE, ACROBOT, MOUNTAIN_CAR, CONTINUOUS_MOUNTAIN_CAR, PENDULUM = range(6)

_ANGLE_LIMIT = 12 * 2 * math.pi / 360
_X_LIMIT = 2.4
_MAX_VELOCITY_1, _MAX_VELOCITY_2 = 4 * math.pi, 9 * math.pi


@compiled
def observe(dynamics, physics, state):
    """Write the observation of `physics` into `state`."""
    if dynamics == ACROBOT:
        state[0], state[1] = math.cos(physics[0]), math.sin(physics[0])
        state[2], state[3] = math.cos(physics[1]), math.sin(physics[1])
        state[4], state[5] = physics[2], physics[3]
    elif dynamics == PENDULUM:
        state[0], state[1], state[2] = math.cos(physics[0]), math.sin(physics[0]), physics[1]
    else:
        for k in range(state.size):
            state[k] = physics[k]


@compiled
def step(dynamics, physics, action):
    """Advance `physics` in place by one step; return reward (NaN for OBSERVED) and termination."""
    if dynamics == CARTPOLE:
        return _cartpole_step(physics, action)
    if dynamics == ACROBOT:
        return _acrobot_step(physics, action)
    if dynamics == MOUNTAIN_CAR:
        return _mountain_car_step(physics, action)
    if dynamics == CONTINUOUS_MOUNTAIN_CAR:
        return _continuous_mountain_car_step(physics, action)
    if dynamics == PENDULUM:
        return _pendulum_step(physics, action)
    return np.nan, True


@compiled
def observe_episodes(dynamics, step_limit, actions, initial_physics, seen):
    """Write the observations before each of the `actions` (n,) into `seen` (n, S). Episodes start
    in the rows of `initial_physics` (n, p), which are overwritten."""
    episode = age = 0
    for k in range(actions.size):
        observe(dynamics, initial_physics[episode], seen[k])
        _, terminated = step(dynamics, initial_physics[episode], actions[k])
        age += 1
        if terminated or age == step_limit:
            episode += 1
            age = 0


@compiled
def _cartpole_step(physics, action):
    x, dx, angle, spin = physics
    force = 10.0 if action == 1 else -10.0
    cos, sin = math.cos(angle), math.sin(angle)
    temp = (force + 0.05 * spin**2 * sin) / 1.1
    dspin = (9.8 * sin - cos * temp) / (0.5 * (4.0 / 3.0 - 0.1 * cos**2 / 1.1))
    ddx = temp - 0.05 * dspin * cos / 1.1
    physics[0] = x + 0.02 * dx
    physics[1] = dx + 0.02 * ddx
    physics[2] = angle + 0.02 * spin
    physics[3] = spin + 0.02 * dspin
    return 1.0, abs(physics[0]) > _X_LIMIT or abs(physics[2]) > _ANGLE_LIMIT


@compiled
def _drive(physics, force):
    """Move the car of both MountainCars by one step."""
    x, dx = physics
    dx = min(max(dx + force - 0.0025 * math.cos(3 * x), -0.07), 0.07)
    x = min(max(x + dx, -1.2), 0.6)
    physics[0], physics[1] = x, 0.0 if x == -1.2 and dx < 0 else dx


@compiled
def _mountain_car_step(physics, action):
    _drive(physics, 0.001 * (action - 1.0))
    return -1.0, physics[0] >= 0.5 and physics[1] >= 0


@compiled
def _continuous_mountain_car_step(physics, action):
    _drive(physics, 0.0015 * action)
    physics[:] = physics.astype(np.float32)  # as in gymnasium
    over = physics[0] >= 0.45 and physics[1] >= 0
    return (100.0 if over else 0.0) - 0.1 * action * action, over


@compiled
def _pendulum_step(physics, action):
    angle, spin = physics
    torque = 2.0 * action
    upright = (angle + math.pi) % (2 * math.pi) - math.pi
    cost = upright**2 + 0.1 * spin**2 + 0.001 * torque**2
    physics[1] = min(max(spin + (15.0 * math.sin(angle) + 3.0 * torque) * 0.05, -8.0), 8.0)
    physics[0] = angle + 0.05 * physics[1]
    return -cost, False


@compiled
def _acrobot_derivatives(angle1, angle2, spin1, spin2, torque):
    """Equations of motion (Sutton and Barto's variant) for masses, lengths and inertia of 1."""
    cos2, sin2 = math.cos(angle2), math.sin(angle2)
    d1 = 0.25 + (1.25 + cos2) + 2.0
    d2 = 0.25 + 0.5 * cos2 + 1.0
    phi2 = 0.5 * 9.8 * math.cos(angle1 + angle2 - math.pi / 2)
    phi1 = (
        -0.5 * spin2**2 * sin2
        - spin2 * spin1 * sin2
        + 1.5 * 9.8 * math.cos(angle1 - math.pi / 2)
        + phi2
    )
    dspin2 = (torque + d2 / d1 * phi1 - 0.5 * spin1**2 * sin2 - phi2) / (1.25 - d2**2 / d1)
    dspin1 = -(d2 * dspin2 + phi1) / d1
    return spin1, spin2, dspin1, dspin2


@compiled
def _wrap(angle):
    """Wrap an angle into [-pi, pi]."""
    if angle > math.pi:
        return angle - 2 * math.pi * math.ceil((angle - math.pi) / (2 * math.pi))
    if angle < -math.pi:
        return angle + 2 * math.pi * math.ceil((-math.pi - angle) / (2 * math.pi))
    return angle


@compiled
def _acrobot_step(physics, action):
    """One Runge-Kutta step of fourth order over 0.2 s."""
    a, b, c, d = physics
    torque = action - 1.0
    dt = 0.2
    a1, b1, c1, d1 = _acrobot_derivatives(a, b, c, d, torque)
    h = dt / 2
    a2, b2, c2, d2 = _acrobot_derivatives(a + h * a1, b + h * b1, c + h * c1, d + h * d1, torque)
    a3, b3, c3, d3 = _acrobot_derivatives(a + h * a2, b + h * b2, c + h * c2, d + h * d2, torque)
    a4, b4, c4, d4 = _acrobot_derivatives(
        a + dt * a3, b + dt * b3, c + dt * c3, d + dt * d3, torque
    )
    angle1 = _wrap(a + dt / 6 * (a1 + 2 * a2 + 2 * a3 + a4))
    angle2 = _wrap(b + dt / 6 * (b1 + 2 * b2 + 2 * b3 + b4))
    spin1 = c + dt / 6 * (c1 + 2 * c2 + 2 * c3 + c4)
    spin2 = d + dt / 6 * (d1 + 2 * d2 + 2 * d3 + d4)
    physics[0], physics[1] = angle1, angle2
    physics[2] = min(max(spin1, -_MAX_VELOCITY_1), _MAX_VELOCITY_1)
    physics[3] = min(max(spin2, -_MAX_VELOCITY_2), _MAX_VELOCITY_2)
    done = -math.cos(angle1) - math.cos(angle2 + angle1) > 1.0
    return (0.0 if done else -1.0), done
