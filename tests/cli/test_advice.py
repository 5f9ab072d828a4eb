"""What a command advises is something that it can do."""

import json
from pathlib import Path

import pytest

from ambid.demo import DATA

LOADS = sorted(DATA.glob("static_*.csv"))


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_static_load_in_milliampere_is_not_to_be_vouched_for(command):
    head, *rows = LOADS[0].read_text().splitlines()
    columns = head.split(",")
    first = next(k for k, name in enumerate(columns) if name.startswith("i_c."))
    lines = [row.split(",") for row in rows]
    text = [",".join([*own[:first], *(str(1e3 * float(cell)) for cell in own[first:])]) for own in lines]
    Path("mA.csv").write_text("\n".join([head, *text]))
    result = command("static-load", DATA / "rig.toml", "mA.csv")
    assert result.code == 2
    assert "it looks like mA; give ampere" in result.err
    assert "--allow" not in result.err


def test_static_load_names_its_own_option(command):
    result = command("static-load", DATA / "rig.toml", *LOADS, "--json", "s.json")
    assert result.code == 0
    assert "with --deflection and the nominal K_s" in result.out
    assert "deflection=True" not in result.out + Path("s.json").read_text()
    assert json.loads(Path("s.json").read_text())["notes"]
