"""A rotor that is not given by its dimensions: from a modal test, or from ROSS."""

import ambid
from ambid.demo import DATA
from ambid.rig import ModalRotor

rig = ambid.Rig.load(DATA / "rig.toml")
record = ambid.Record.load(DATA / "prbs.mat", rig)

# Weighed: mass, centre of mass, transverse inertia. From an impact test of the hanging rotor: frequencies, damping, and
# shapes at unit modal mass. Points must be at every magnet and sensor.
mass, centre, inertia = 69.0, 0.43, 3.429  # kg, m, kg m^2
points = (0.14, 0.20, 0.43, 0.66, 0.72)  # m
rotor = ModalRotor.model_validate(
    {
        "frequencies_hz": [0.0, 0.0, 553.79, 1382.7],
        "damping": [0.0, 0.0, 0.004, 0.004],
        "positions": points,
        "shapes": [  # 1/sqrt(kg)
            [mass**-0.5 for _ in points],
            [(z - centre) * inertia**-0.5 for z in points],
            [0.1057, 0.0247, -0.1459, 0.0247, 0.1057],
            [0.0235, -0.0858, 0.0, 0.0858, -0.0235],
        ],
    }
)
estimates = {"modal test": ambid.identify(rig.replace(rotor=rotor), record), "dimensions": ambid.identify(rig, record)}
for source, estimate in estimates.items():
    fit, k_i = estimate.fit_percent["average"], estimate.parameters["K_i.A_zeta"].value
    print(f"{source}: fit {fit:.2f} %, K_i.A_zeta {k_i:.1f}")

# From ROSS: made without bearing_elements, since the magnets are in the rig; nodes at every magnet and sensor.
try:
    import ross
except ImportError:
    print("ROSS is not installed: pip install ross-rotordynamics")
else:
    steel = ross.Material(name="steel", rho=7850.0, E=2.06e11, Poisson=0.3)
    shaft = [ross.ShaftElement(L=0.02, idl=0.0, odl=0.1, material=steel) for _ in range(43)]
    disk = ross.DiskElement(n=21, m=16.0, Id=0.05, Ip=0.1)
    taken = ambid.rotor_from_ross(ross.Rotor(shaft, [disk]), flexible_modes=2, modal_damping=0.004)
    model = ambid.Model(rig.replace(rotor=taken))
    print(f"ROSS: {len(taken.node_positions)} nodes, {'stable' if model.is_stable else 'unstable'}")
