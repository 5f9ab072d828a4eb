"""What several tests of the commands share: a loop with a delay more than its rig file states, and its records."""

import pytest

import ambid
from places import LEVITATOR

DELAY = 5e-5


@pytest.fixture(scope="session")
def late(tmp_path_factory):
    """A rig file of one axis, and two records of the machine, at two amplitudes, whose loop has a delay more."""
    folder = tmp_path_factory.mktemp("late")
    rig = ambid.Rig.load(LEVITATOR)
    (folder / "rig.toml").write_text(rig.to_toml())
    truth = ambid.Model(rig).add("loop_delay", {"delay": DELAY})
    for name, amplitude, periods in (("run", 0.1, 5), ("other", 0.06, 5), ("brief", 0.1, 2)):
        i_e = ambid.prbs(8, amplitude=amplitude, hold=2, axes=1, periods=periods)
        truth.virtual_experiment(i_e, seed=20 + periods).save(folder / f"{name}.csv")
    return folder


@pytest.fixture
def here(late, tmp_path, monkeypatch):
    """An empty folder to write into, where the command runs."""
    monkeypatch.chdir(tmp_path)
    return (late / "rig.toml", late / "run.csv")


@pytest.fixture(scope="session")
def diagnosed(late, tmp_path_factory, command_in):
    """A folder with all that `diagnose` may write of the late loop, and how it ended.

    The report, whose pictures take long, is its text alone.
    """
    folder = tmp_path_factory.mktemp("diagnosed")
    files = ("--json", "d.json", "--save", "m.json", "--plot", "d.png", "--report", "d.html")
    given = (late / "rig.toml", late / "run.csv", "--validate", late / "other.csv")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ambid.report, "write_report", lambda found, path: path.write_text(str(found)))
        return folder, command_in(folder, "diagnose", *given, *files)


@pytest.fixture
def refused(golden, late):
    """Hold a command that was refused, with the text of why: it names what was wrong, as it was given.

    Nothing is printed, unless its result was there before a file could not be made of it.
    """

    def hold(result, named="", code=2, *, prints=False):
        assert (result.code, bool(result.out)) == (code, prints)
        assert str(named) in result.err
        catalogue = ", ".join(effect.name for effect in ambid.CATALOGUE)
        golden.holds(result.err.replace(str(late), "<late>").replace(catalogue, "<catalogue>"))

    return hold
