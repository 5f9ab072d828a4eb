"""The report of each verdict, and of diagnoses of other shapes."""

import re
from dataclasses import replace

import numpy as np
import pytest

import ambid
from ambid.diagnosis import Diagnosis
from ambid.findings import REMARK, SEVERITIES, Where
from ambid.report import numbers, words
from ambid.robustness.procedure import CURVED_PEAK, UNSTABLE_DRAWS
from places import LEVITATOR
from report.page import hash_of


def test_hashes_are_those_of_what_was_read(explained, tmp_path, page):
    rig, record = tmp_path / "rig.toml", tmp_path / "run.mat"
    rig.write_bytes(LEVITATOR.read_bytes().replace(b"\n", b"\r\n"))
    explained.records[0].save(record)
    hashes = [hash_of(path) for path in (rig, record)]
    machine = ambid.Rig.load(rig)
    read = ambid.Record.load(record, machine)
    rig.write_text("another one")
    record.unlink()
    found = page(Diagnosis.uninformative(ambid.Model(machine), [read.rows(0, read.samples)], [REMARK(text="why")], 0.0))
    assert [row[3] for row in found.tables["files"]] == hashes


def test_what_is_in_no_file_has_no_hash(explained, page):
    record = replace(explained.records[0], path=None, provenance=None)
    found = page(Diagnosis.uninformative(explained.model, [record], [REMARK(text="why")], 0.0))
    _, (name, _, size, sha256) = found.tables["files"]
    assert (name, size) == (record.name, "–")
    assert not re.fullmatch(r"[0-9a-f]+", sha256)


@pytest.mark.slow
def test_of_many_records_the_worst_three_are_drawn_and_a_table_has_all(explained, page):
    base, record, other = explained.history[0].model, explained.records[0], explained.validation[0]
    records = [replace(other if k == 1 else record, name=f"run {k}") for k in range(4)]
    several = replace(explained, records=tuple(records), fit=ambid.compare(explained.model, records))
    found = page(several)
    rows = found.tables["shown"]
    assert [row[:2] for row in rows] == [*([f"run {k}", "diagnosis"] for k in range(4)), ["other", "validation"]]
    before, after = (several.fit.of(model).records for model in (base, explained.model))
    for row, was, now in zip(rows, before, after, strict=False):
        assert row[4] == f"{words.misfit(was.misfit)} → {words.misfit(now.misfit)}"
    worst = sorted(sorted(range(4), key=lambda k: -before[k].misfit)[:3])
    drawn = {name: count for name, count in found.images.items() if name.startswith(("run", "other"))}
    assert drawn == {f"run {k}": 2 for k in worst}


def test_an_unstable_model_has_no_margins_and_a_report(explained, page):
    weak = explained.model.with_values({"K_i.A_zeta": 1e-3 * explained.model.theta[0]})
    assert not weak.is_stable
    found = page(replace(explained, model=weak))
    assert len(found.classes["no-margins"]) == 1
    assert "margins" not in found.tables


@pytest.mark.slow
def test_findings_are_shown_worst_first(explained, page):
    model = explained.model
    unsure = model.with_covariance(np.diag((0.3 * model.theta) ** 2))
    found = page(replace(explained, model=unsure))
    for own in found.findings:
        severities = [severity for severity, _ in own]
        assert severities == sorted(severities, key=SEVERITIES.index)
    assert {("warning", UNSTABLE_DRAWS.code), ("note", CURVED_PEAK.code)} <= set(found.findings[-1])


def test_ambiguous_shows_the_set_and_the_next_experiment(explained, page, golden):
    names = ["loop_delay", "amplifier_bandwidth"]
    found = page(replace(explained, verdict="ambiguous", ambiguous_sets=[names]))
    golden.holds(found.outline)
    assert [row[0] for row in found.tables["choices-1"]] == names


@pytest.mark.slow
def test_none_says_where_and_adds_nothing(explained, page, golden):
    model = numbers.base_model(explained)
    none = replace(explained, verdict="none_of_the_candidates", effects=(), model=model, history=explained.history[:1])
    located = explained.localisation.findings
    found = page(replace(none, findings=(*located, REMARK(text="beside that"))))
    assert found.findings[0] == [("note", REMARK.code)]  # where it fails stands in its own chapter
    assert [(own.severity, own.code) for own in located] in found.findings
    golden.holds(found.outline)
    assert "ledger" not in found.tables
    assert {"cells", "ports"} <= set(found.tables)


def test_steps_that_led_nowhere_are_said_to_be_taken_back(explained, page, golden):
    none = replace(explained, verdict="none_of_the_candidates", effects=(), model=numbers.base_model(explained))
    found = page(none)
    golden.holds(found.outline)
    assert len(found.classes["taken-back"]) == 1
    assert len(found.tables["ledger"]) == 2


def test_adequate_claims_no_failure(explained, page, golden):
    step = explained.history[-1]
    calm = replace(step, effects=(), added=None, model=numbers.base_model(explained))
    adequate = replace(
        explained, verdict="adequate", effects=(), history=[calm], model=numbers.base_model(explained), findings=()
    )
    found = page(adequate)
    golden.holds(found.outline)
    assert "invisible" in found.tables
    assert not {"cells", "ports"} & set(found.tables)


def test_not_informative_says_why_and_what_to_do(explained, page, golden):
    why = "only 2 periods <of> the excitation"
    finding = REMARK(Where(record="train"), text=why)
    found = page(Diagnosis.uninformative(explained.model, explained.records, [finding], 0.0))
    golden.holds(found.outline)
    assert found.findings == [[("note", REMARK.code)]]
    assert found.html.count(f"train: {why}".replace("<", "&lt;").replace(">", "&gt;")) == 1
    assert found.sources == []
