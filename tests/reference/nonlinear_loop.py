"""A levitated mass with nonlinear blocks, for the core and for an adaptive integrator restarted at every sample."""

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.special import ndtr

from ambid import _core

DT = 1e-4
MASS, TAU_A, TAU_D = 8.0, 2e-4, 1e-4
P, I, D = 3.2e4, 2e5, 64.0  # PID: A/m, A/(m s), A s/m
BIAS = 2.5
# parameters that every loop has
K_I, K_S, TAU_E = 0, 1, 2
NAMES = ("s", "v", "i_a", "i_f", "h")
AMPLITUDE = 1.5


@dataclass
class Plant:
    """A levitated mass with its blocks, as matrices and as Python functions."""

    matrices: tuple[np.ndarray, ...]
    blocks: list[dict]
    laws: list  # functions of (theta, z), or of columns of both
    theta: np.ndarray
    digital: dict | None = None

    def core(self, **options) -> _core.ClosedLoop:
        gains = [(K_I, 1.0, 1), (K_S, 1.0, 1), (TAU_E, 1.0, -1)]
        return _core.ClosedLoop(self.matrices, gains, len(self.theta), DT, self.digital, self.blocks, **options)

    def closed(self, theta):
        """Matrices with the gains closed: inputs [u, w of the blocks], outputs [y, z of the blocks]."""
        A, B, C, D_ = self.matrices
        g, nu, ny = slice(1, 4), [0, *range(4, B.shape[1])], [0, 1, *range(5, len(C))]
        z = slice(2, 5)
        delta = np.diag([theta[K_I], theta[K_S], 1 / theta[TAU_E]])
        w = delta @ np.linalg.inv(np.eye(3) - D_[z, g] @ delta)
        return (
            A + B[:, g] @ w @ C[z],
            B[:, nu] + B[:, g] @ w @ D_[z][:, nu],
            C[ny] + D_[ny][:, g] @ w @ C[z],
            D_[np.ix_(ny, nu)] + D_[ny][:, g] @ w @ D_[z][:, nu],
        )

    def reference(self, theta, u):
        """Outputs y, i_c at the samples, from rest."""
        return self.references(np.asarray(theta)[None], u)[0]

    def references(self, thetas, u):
        """The same for several vectors of parameters, which are integrated side by side: vectors x samples x outputs.

        Columns of arrays in here belong to the vectors. Intervals that depend on the parameters are scaled to one.
        """
        A, B, C, D_ = (np.stack(own) for own in zip(*map(self.closed, thetas), strict=True))
        theta, counts = thetas.T, [law.inputs for law in self.laws]

        def times(matrices, columns):
            return np.matmul(matrices, columns.T[..., None])[..., 0].T

        def signals(x, command):
            """w of the blocks, each of which may read w of those before."""
            v = np.zeros((len(self.laws), len(thetas)))
            first = 2
            for k, (law, count) in enumerate(zip(self.laws, counts, strict=True)):
                rows = slice(first, first + count)
                z = times(C[:, rows], x) + D_[:, rows, 0].T * command + times(D_[:, rows, 1:], v)
                v[k] = law(theta, z)
                first += count
            return v

        def advance(x, command, seconds):
            def rate(_, flat):
                x = flat.reshape(-1, len(thetas))
                change = times(A, x) + B[:, :, 0].T * command + times(B[:, :, 1:], signals(x, command))
                return (seconds * change).ravel()

            if not np.any(seconds):
                return x
            return solve_ivp(rate, (0, 1), x.ravel(), "DOP853", rtol=1e-11, atol=1e-16).y[:, -1].reshape(x.shape)

        def outputs(x, command):
            own = times(C[:, :2], x) + D_[:, :2, 0].T * command
            return own + times(D_[:, :2, 1:], signals(x, command))

        x, y = np.zeros((A.shape[1], len(thetas))), np.empty((len(thetas), len(u), 2))
        if self.digital is None:
            for k, command in enumerate(u[:, 0]):
                y[:, k] = outputs(x, command).T
                x = advance(x, command, DT)
            return y
        ka, kb, kc, kd = self.digital["matrices"]
        steps, late_by = self.digital["steps"], self.digital["late"]
        delay = self.digital["delay"] + (0.0 * theta[0] if late_by is None else theta[late_by] * steps / DT)
        whole, fraction = np.divmod(delay, 1.0)
        (whole,) = {int(own) for own in whole}
        commands, control = [np.zeros(len(thetas))] * (whole + 2), np.zeros((len(ka), len(thetas)))
        for k, excitation in enumerate(u[:, 0]):
            for step in range(steps):
                read = outputs(x, 0.0)[:1]
                commands = [excitation - kc[0] @ control - kd[0] @ read, *commands[:-1]]
                control = ka @ control + kb @ read
                late = commands[whole]
                first = np.where(fraction, commands[whole + 1], late)
                if step == 0:
                    y[:, k] = outputs(x, first).T
                x = advance(x, first, fraction * DT / steps)
                x = advance(x, late, (1 - fraction) * DT / steps)
        return y

    def slopes(self, u):
        """The reference at theta, and its derivatives by four-point differences; samples x outputs (x parameters)."""
        steps = 1e-3 * np.diag(np.abs(self.theta))
        moved = np.concatenate([self.theta + n * steps for n in (1, -1, 2, -2)])
        y, *others = self.references(np.vstack([self.theta, moved]), u)
        near, back, far, far_back = np.reshape(others, (4, len(steps), len(u), 2))
        change = 8 * (near - back) - (far - far_back)
        return y, np.moveaxis(change / (12 * np.diag(steps)[:, None, None]), 0, -1)


def law(inputs):
    def mark(function):
        function.inputs = inputs
        return function

    return mark


def machine(ports, laws, blocks, extra=(), delay=None, steps=1, late=None) -> Plant:
    """The mass with the blocks in `ports`: per block, rows of z over states and signals, and where w acts.

    `late` is a further delay in controller samples, the last parameter.
    """
    analog = delay is None
    names = [*NAMES, "xi", "xd"] if analog else [*NAMES]
    at = {name: i for i, name in enumerate(names)}
    n, nv, nq = len(names), len(ports), sum(len(port["z"]) for port in ports)
    A, B = np.zeros((n, n)), np.zeros((n, 4 + nv))
    C, D_ = np.zeros((5 + nq, n)), np.zeros((5 + nq, 4 + nv))
    A[at["s"], at["v"]] = 1
    A[at["i_a"], at["i_a"]] = -1 / TAU_A
    B[at["i_a"], 0] = 1 / TAU_A
    B[at["v"], 1] = B[at["v"], 2] = 1 / MASS
    B[at["i_f"], 3] = 1
    A[at["v"], at["h"]] = -1 / MASS  # the hysteresis state is a force
    A[at["h"], at["h"]] = -3.0
    C[0, at["s"]] = C[1, at["i_a"]] = 1  # y, i_c
    C[2, at["i_f"]] = C[3, at["s"]] = C[4, at["i_a"]] = 1
    C[4, at["i_f"]] = -1
    digital = None
    if analog:
        i_ref = np.zeros(n)
        i_ref[[at["s"], at["xi"], at["xd"]]] = -(P + D / TAU_D), -I, D / TAU_D
        A[at["i_a"]] += i_ref / TAU_A
        A[at["xi"], at["s"]] = 1
        A[at["xd"], at["s"]], A[at["xd"], at["xd"]] = 1 / TAU_D, -1 / TAU_D
    else:
        i_ref = np.zeros(n)
        t = DT / steps
        # backward difference, filtered
        pole = np.exp(-t / TAU_D)
        matrices = (
            np.array([[1.0, 0.0], [0.0, pole]]),
            np.array([[t], [1.0]]),
            np.array([[I, -D * (1 - pole) ** 2 / t]]),
            np.array([[P + D * (1 - pole) / t]]),
        )
        digital = {"matrices": matrices, "delay": delay, "steps": steps}
        digital["late"] = None if late is None else 3 + len(extra)
    first = 5
    for k, port in enumerate(ports):
        for row in port["z"]:
            for name, factor in row.items():
                if name == "rate":  # of the amplifier: (i_ref - i_a) / tau_a
                    C[first] += factor * i_ref / TAU_A
                    C[first, at["i_a"]] -= factor / TAU_A
                    D_[first, 0] += factor / TAU_A
                elif name == "flux rate":  # w of the gain 1/tau_e
                    D_[first, 3] += factor
                elif name.startswith("w"):
                    D_[first, 4 + int(name[1:])] += factor
                else:
                    C[first, at[name]] += factor
            first += 1
        for name, factor in port["w"].items():
            if name == "y":
                D_[0, 4 + k] += factor
                if analog:
                    B[at["i_a"], 4 + k] -= factor * (P + D / TAU_D) / TAU_A
                    B[at["xi"], 4 + k] += factor
                    B[at["xd"], 4 + k] += factor / TAU_D
            else:
                B[at[name], 4 + k] += factor
    theta = np.array([180.0, 1.6e6, 4e-4, *extra, *([] if late is None else [late * DT / steps])])
    return Plant((A, B, C, D_), blocks, laws, theta, digital)


def curve(kind, sigma, n):
    if kind == "unsaturated":
        return lambda x: x
    if kind == "tanh":
        return lambda x: np.tanh(sigma * x) / sigma
    return lambda x: x / (1 + (sigma * x) ** n) ** (1 / n)


def force_law(kind, nu, sigma=0.5, n=3.0, single=False, **digital) -> Plant:
    @law(2)
    def extra_force(theta, z):
        nu, *own = theta[3 : 4 + len(shape)]
        b = curve(kind, *(own + [1.0] * (2 - len(own))))
        i0 = BIAS / nu
        s0 = theta[K_I] * i0 / theta[K_S]

        def pull(sign):
            return b(np.maximum(0.0, (1 + sign * z[0] / i0) / (1 - sign * z[1] / s0))) ** 2

        h = 1e-3
        stencil = 8 * (b(1 + h) ** 2 - b(1 - h) ** 2) - (b(1 + 2 * h) ** 2 - b(1 - 2 * h) ** 2)
        slope = stencil / (12 * h)
        against = (pull(1) - b(1.0) ** 2) / slope if single else (pull(1) - pull(-1)) / (2 * slope)
        force = theta[K_I] * i0 * against
        return force - theta[K_I] * z[0] - theta[K_S] * z[1]

    shape = {"unsaturated": (), "tanh": (sigma,), "power": (sigma, n)}[kind]
    parameters = {"K_i": K_I, "K_s": K_S, "nu": 3} | dict(zip(("sigma", "n"), range(4, 4 + len(shape)), strict=False))
    block = {"law": "force_law", "curve": kind, "parameters": parameters, "constants": {"bias": BIAS}}
    block["single"] = single
    port = {"z": [{"i_f": 1.0}, {"s": 1.0}], "w": {"v": 1 / MASS}}
    return machine([port], [extra_force], [block], (nu, *shape), **digital)


def limit(**digital) -> Plant:
    """The mean of a clipped normal variable, from those of its three pieces."""

    @law(1)
    def taken(theta, z):
        if not np.any(theta[3]):
            return 0.0 * z[0]
        limit, noise = 1 / theta[3], theta[4]
        low, high = (-limit - z[0]) / noise, (limit - z[0]) / noise
        within = z[0] * (ndtr(high) - ndtr(low)) + noise * (np.exp(-(low**2) / 2) - np.exp(-(high**2) / 2)) / np.sqrt(
            2 * np.pi
        )
        return limit * (ndtr(-high) - ndtr(low)) + within - z[0]

    block = {"law": "limit", "parameters": {"inverse_limit": 3, "noise": 4}}
    return machine([{"z": [{"rate": 1.0}], "w": {"i_a": 1.0}}], [taken], [block], (1 / 8e3, 2e3), **digital)


def bouc_wen(n, coordinates=1, **digital) -> Plant:
    rate, state = 200.0, 0.05

    @law(2 * coordinates)
    def hysteresis(theta, z):
        a, beta, gamma, inverse_n = theta[3:7]
        rates, states = z[::2], z[1::2]
        radius = np.sqrt((states**2).sum(axis=0) + state**2)
        along = (rates * states).sum(axis=0) / radius
        power = np.where(radius < 1.0, radius ** (1.0 / inverse_n), 1.0 + (radius - 1.0) / inverse_n)
        back = beta * (np.hypot(along, rate) - rate) + gamma * along
        return a * rates[0] - back * power * states[0] / radius

    parameters = {"A": 3, "beta": 4, "gamma": 5, "inverse_n": 6}
    constants = {"coordinates": coordinates, "rate_smoothing": rate, "state_smoothing": state}
    block = {"law": "bouc_wen", "parameters": parameters, "constants": constants}
    z = [{"flux rate": 1.0}, {"h": 1.0 / 60.0}, {"v": 2e4}, {"i_f": 0.3}]
    port = {"z": z[: 2 * coordinates], "w": {"h": 1.0}}
    return machine([port], [hysteresis], [block], (60.0, 36.0, 24.0, 1.0 / n), **digital)


def stop(coordinates, **digital) -> Plant:
    smoothing = 4e-6

    @law(2 * coordinates)
    def contact(theta, z):
        clearance, damping = theta[3:5]
        places, rates = z[::2], z[1::2]
        radius = np.sqrt((places**2).sum(axis=0)) + 1e-30
        t = np.clip((radius - clearance + smoothing) / (2 * smoothing), 0.0, 1.0)
        depth = 2 * smoothing * (t**3 - t**4 / 2) + np.maximum(radius - clearance - smoothing, 0.0)
        return -depth * (1 + damping * (places * rates).sum(axis=0) / radius) * places[0] / radius

    parameters = {"clearance": 3, "damping": 4}
    constants = {"coordinates": coordinates, "smoothing": smoothing}
    block = {"law": "stop", "parameters": parameters, "constants": constants}
    z = [{"s": 1.0}, {"v": 1.0}, {"i_f": 1e-5}, {"flux rate": 1e-5}]
    port = {"z": z[: 2 * coordinates], "w": {"v": 1e6 / MASS}}
    return machine([port], [contact], [block], (1e-5, 20.0), **digital)


def polynomials(**digital) -> Plant:
    """A force, a bent sensor, and a block that reads w of another."""

    @law(2)
    def force(theta, z):
        return theta[3] * z[0] ** 3 + theta[4] * z[0] * z[1] ** 2 + 2e5 * z[1]

    @law(1)
    def sensor(theta, z):
        return theta[5] * z[0] ** 3

    @law(1)
    def follower(theta, z):
        return 1e-4 * z[0] ** 2

    blocks = [
        {
            "law": "polynomial",
            "exponents": [[3, 0], [1, 2], [0, 1]],
            "parameters": {"c0": 3, "c1": 4},
            "constants": {"c2": 2e5},
        },
        {"law": "polynomial", "exponents": [[3]], "parameters": {"c0": 5}},
        {"law": "polynomial", "exponents": [[2]], "constants": {"c0": 1e-4}},
    ]
    ports = [
        {"z": [{"i_f": 1.0}, {"s": 1.0}], "w": {"v": 1 / MASS}},
        {"z": [{"s": 1.0}], "w": {"y": 1.0}},
        {"z": [{"w0": 1.0, "s": 1e5}], "w": {"v": 1 / MASS}},
    ]
    return machine(ports, [force, sensor, follower], blocks, (10.0, 3e10, 4e6), **digital)


KINDS = {
    "unsaturated": lambda **k: force_law("unsaturated", 1.0, **k),
    "tanh": lambda **k: force_law("tanh", 1.0, **k),
    "power": lambda **k: force_law("power", 0.8, **k),
    "single": lambda **k: force_law("unsaturated", 1.0, single=True, **k),
    "single power": lambda **k: force_law("power", 0.8, single=True, **k),
    "limit": limit,
    "hysteresis": lambda **k: bouc_wen(1.0, **k),
    "sharp hysteresis": lambda **k: bouc_wen(4.0, **k),
    "biaxial hysteresis": lambda **k: bouc_wen(2.0, 2, **k),
    "stop": lambda **k: stop(1, **k),
    "round stop": lambda **k: stop(2, **k),
    "polynomials": polynomials,
}
LOOPS = {
    "analog": {},
    "digital": {"delay": 0.0},
    "delayed": {"delay": 1.3, "steps": 2},
    "late": {"delay": 0.3, "late": 0.5, "steps": 2},
}


def excitation(samples, amplitude=AMPLITUDE):
    rng = np.random.default_rng(5)
    return amplitude * np.repeat(rng.choice([-1.0, 1.0], -(-samples // 3)), 3)[:samples, None]
