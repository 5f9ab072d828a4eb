"""Write ross_rotors.json and ross_taken.npz: reference values of the rotor tests, computed by ROSS 2.3.0.

To run it again, outside the environment of ambid:

    python -m venv ross && ross/bin/pip install ross-rotordynamics==2.3.0 "plotly<6"
    ross/bin/python tests/reference/ross_rotors.py

Shear coefficient: ROSS's default, Cowper (1966). What ROSS 2.3.0 calls "hutchinson" is, for a solid section,
6 (1 + nu) / (7 + 12 nu + 4 nu^2); Hutchinson (2001) has (1 + nu)^2 in the numerator.
"""

import json
from pathlib import Path

import numpy as np
import ross as rs
from scipy.linalg import eigh, eigvals

LATERAL = [0, 1, 3, 4]  # of ROSS's freedoms x, y, z, alpha, beta, theta
PIECES = 16  # elements a section

MATERIAL = {"density": 7810.0, "youngs_modulus": 2.11e11, "poisson_ratio": 0.29}
SECTIONS = [  # length, outer diameter, inner diameter [m]
    (0.05, 0.030, 0.0),
    (0.12, 0.050, 0.020),
    (0.20, 0.060, 0.040),
    (0.10, 0.050, 0.0),
    (0.07, 0.035, 0.010),
]
DISKS = [
    (1, 3.0, 0.010, 0.018),
    (3, 5.5, 0.030, 0.055),
    (5, 1.2, 0.002, 0.0035),
]  # section end, mass, transverse, polar
SPEEDS_RAD_S = [800.0, 3000.0]
CONES = [(0.10, 0.030, 0.055, 0.012), (0.25, 0.055, 0.040, 0.012), (0.08, 0.040, 0.025, 0.0)]
"""Length, outer diameter at either end, inner diameter [m]."""
HELD = {
    "cones": CONES,
    "disks": [(0.10, 2.5, 0.008, 0.014)],  # z, mass, transverse, polar
    "supports": [(0.0, 3e5, 40.0), (0.35, 5e5, 90.0)],  # z, N/m, N s/m
    "mass_damping": 2.5,
    "speeds_rad_s": [0.0, 900.0],
}
TAKEN_SPEEDS = (0.0, 300.0)
"""Of the poles of the rotors that are taken over [rad/s]; BELOW is the fastest of them [1/s]."""
BELOW = 5000.0
RESPONSE_SPEEDS = np.linspace(20.0, 900.0, 23)
UNBALANCE = 1e-4
ELEMENT = {"length": 0.08, "outer_diameter": 0.07, "inner_diameter": 0.03}


def shaft_element(length: float, outer: float, inner: float) -> rs.ShaftElement:
    material = rs.Material(
        "steel", rho=MATERIAL["density"], E=MATERIAL["youngs_modulus"], Poisson=MATERIAL["poisson_ratio"]
    )
    return rs.ShaftElement(length, inner, outer, material=material, shear_method_calc="cowper")


def lateral(matrix: np.ndarray) -> np.ndarray:
    keep = [6 * node + freedom for node in range(len(matrix) // 6) for freedom in LATERAL]
    return matrix[np.ix_(keep, keep)]


def rotor() -> dict:
    shaft = [shaft_element(length / PIECES, outer, inner) for length, outer, inner in SECTIONS for _ in range(PIECES)]
    disks = [rs.DiskElement(n=end * PIECES, m=m, Id=transverse, Ip=polar) for end, m, transverse, polar in DISKS]
    free = [rs.BearingElement(n=node, kxx=0.0, cxx=0.0) for node in (0, len(shaft))]
    model = rs.Rotor(shaft, disks, free)
    M, K, G = lateral(model.M()), lateral(model.K(0)), lateral(model.G())
    at_rest = np.sqrt(eigh(K, M, eigvals_only=True, subset_by_index=[4, 11])[::2])

    # Whirl in complex form: with r = x + j y the isotropic rotor has half the freedoms, and the sign of its
    # frequency distinguishes forward (+) from backward (-).
    nodes = len(shaft) + 1
    rotate = np.kron(np.eye(nodes), np.array([[1, 1j, 0, 0], [0, 0, -1j, 1]])) / np.sqrt(2)
    M, K, G = (rotate @ matrix @ rotate.conj().T for matrix in (M, K, G))
    forward, backward = [], []
    for speed in SPEEDS_RAD_S:
        inverse = np.linalg.inv(M)
        state = np.block([[np.zeros_like(M), np.eye(len(M))], [-inverse @ K, -speed * inverse @ G]])
        whirl = np.sort(eigvals(state).imag)
        bending = whirl[np.abs(whirl) > 0.6 * at_rest[0]]
        forward.append(bending[bending > 0.0][:3].tolist())
        backward.append((-bending[bending < 0.0][::-1][:3]).tolist())

    z = np.concatenate([[0.0], np.cumsum([element.L for element in shaft])])
    return {
        "material": MATERIAL,
        "sections": SECTIONS,
        "disks": DISKS,
        "mass_kg": model.m,
        "centre_m": model.CG,
        "transverse_inertia_kg_m2": transverse_inertia(lateral(model.M()), z),
        "frequencies_rad_s": at_rest[:4].tolist(),
        "speeds_rad_s": SPEEDS_RAD_S,
        "forward_rad_s": forward,
        "backward_rad_s": backward,
    }


def held_rotor() -> dict:
    """Conical shaft on springs and dampers, all of it damped to ground in proportion to its mass."""
    material = rs.Material(
        "steel", rho=MATERIAL["density"], E=MATERIAL["youngs_modulus"], Poisson=MATERIAL["poisson_ratio"]
    )
    shaft = []
    for length, first, last, inner in CONES:
        ends = np.linspace(first, last, PIECES + 1)
        shaft += [
            rs.ShaftElement(length / PIECES, inner, a, inner, b, material=material, shear_method_calc="cowper")
            for a, b in zip(ends[:-1], ends[1:], strict=True)
        ]
    z = np.concatenate([[0.0], np.cumsum([element.L for element in shaft])])
    node = {place: int(np.argmin(np.abs(z - place))) for place, *_ in (*HELD["disks"], *HELD["supports"])}
    disks = [rs.DiskElement(n=node[at], m=m, Id=transverse, Ip=polar) for at, m, transverse, polar in HELD["disks"]]
    springs = [rs.BearingElement(n=node[at], kxx=k, cxx=c) for at, k, c in HELD["supports"]]
    model = rs.Rotor(shaft, disks, springs)
    M, K, G, C = (lateral(matrix) for matrix in (model.M(0), model.K(0), model.G(), model.C(0)))
    C = C + HELD["mass_damping"] * M
    poles = []
    for speed in HELD["speeds_rad_s"]:
        inverse = np.linalg.inv(M)
        state = np.block([[np.zeros_like(M), np.eye(len(M))], [-inverse @ K, -inverse @ (C + speed * G)]])
        found = eigvals(state)
        found = found[found.imag > 0.0]
        slowest = found[np.argsort(np.abs(found))][:8]
        poles.append([[float(p.real), float(p.imag)] for p in slowest])
    return HELD | {
        "mass_kg": model.m,
        "centre_m": model.CG,
        "transverse_inertia_kg_m2": transverse_inertia(M, z),
        "poles_per_s": poles,
    }


def transverse_inertia(M: np.ndarray, z: np.ndarray) -> float:
    shift = np.tile([1.0, 0.0, 0.0, 0.0], len(z))
    tilt = np.column_stack([z, 0.0 * z, 0.0 * z, np.ones_like(z)]).ravel()
    return float(tilt @ M @ tilt - (shift @ M @ tilt) ** 2 / (shift @ M @ shift))


def element() -> dict:
    one = shaft_element(ELEMENT["length"], ELEMENT["outer_diameter"], ELEMENT["inner_diameter"])
    return ELEMENT | MATERIAL | {name: lateral(getattr(one, name)()).tolist() for name in ("M", "G", "K")}


def friswell_steel() -> rs.Material:
    return rs.Material(name="steel", rho=7810.0, E=211e9, G_s=81.2e9)


def two_disks() -> rs.Rotor:
    """Friswell, Penny, Garvey, Lees, Dynamics of Rotating Machines, 2010, example 5.9.1."""
    shaft = [rs.ShaftElement(0.25, 0.0, 0.05, material=friswell_steel()) for _ in range(6)]
    disks = [
        rs.DiskElement.from_geometry(n, friswell_steel(), width=0.07, i_d=0.05, o_d=o_d)
        for n, o_d in ((2, 0.28), (4, 0.35))
    ]
    return rs.Rotor(shaft, disks, [rs.BearingElement(n, kxx=1e6, cxx=100.0) for n in (0, 6)])


def overhung() -> rs.Rotor:
    """The same shaft with the larger disk beyond the second bearing."""
    shaft = [rs.ShaftElement(0.25, 0.0, 0.05, material=friswell_steel()) for _ in range(6)]
    disk = rs.DiskElement.from_geometry(6, friswell_steel(), width=0.07, i_d=0.05, o_d=0.35)
    return rs.Rotor(shaft, [disk], [rs.BearingElement(n, kxx=1e7, cxx=500.0) for n in (0, 4)])


def tapered() -> rs.Rotor:
    """The same book, example 5.9.9: from 25 to 40 mm over 1.5 m, a disk at the middle."""
    ends = np.linspace(0.025, 0.040, 31)
    shaft = [
        rs.ShaftElement(0.05, 0.0, a, 0.0, b, material=friswell_steel())
        for a, b in zip(ends[:-1], ends[1:], strict=True)
    ]
    disk = rs.DiskElement.from_geometry(15, friswell_steel(), width=0.04, i_d=0.0325, o_d=0.25)
    return rs.Rotor(shaft, [disk], [rs.BearingElement(n, kxx=1e7, cxx=1000.0) for n in (0, 30)])


def taken(name: str, model: rs.Rotor) -> dict[str, np.ndarray]:
    """What `rotor_from_ross` reads, and ROSS's poles and unbalance response at the first bearing."""
    speeds = [0.0, *TAKEN_SPEEDS, *RESPONSE_SPEEDS]
    own = {key: np.asarray(getattr(model, key)(0.0), float) for key in ("M", "K", "C")}
    own |= {"G": np.asarray(model.G(), float), "z": np.asarray(model.nodes_pos, float)}
    own |= {"bearing_nodes": np.array([bearing.n for bearing in model.bearing_elements])}
    own |= {"magnetic": np.array(["Magnetic" in type(bearing).__name__ for bearing in model.bearing_elements])}
    for key in ("M", "K", "C"):
        lateral_parts = [
            [np.asarray(getattr(bearing, key)(speed), float)[:2, :2] for speed in speeds]
            for bearing in model.bearing_elements
        ]
        own[f"bearing_{key}"] = np.array(lateral_parts)
    for k, speed in enumerate(TAKEN_SPEEDS):
        poles = eigvals(model.A(speed, frequency=speed))
        own[f"poles_{k}"] = poles[(poles.imag > 0.0) & (np.abs(poles) < BELOW)]
    node, probe = model.disk_elements[0].n, model.bearing_elements[0].n
    response = model.run_unbalance_response(node, UNBALANCE, 0.0, RESPONSE_SPEEDS)
    own |= {"unbalance_node": np.array(node), "response": response.forced_resp[6 * probe]}
    return {f"{name}/{key}": value for key, value in own.items()} | {"speeds": np.array(speeds)}


ROTORS = {"magnetic": rs.rotor_amb_example, "two disks": two_disks, "overhung": overhung, "tapered": tapered}
"""What makes each rotor that is taken over."""


if __name__ == "__main__":
    arrays: dict[str, np.ndarray] = {}
    for label, make in ROTORS.items():
        arrays |= taken(label, make())
    np.savez_compressed(Path(__file__).with_name("ross_taken.npz"), **arrays)
    target = Path(__file__).with_name("ross_rotors.json")
    target.write_text(
        json.dumps({"ross": "2.3.0", "element": element(), "rotor": rotor(), "held": held_rotor()}, indent=1) + "\n"
    )
