"""Which cases are drawn, what follows for the others, and how often false tables are found."""

from __future__ import annotations

import hashlib
import random
import subprocess
from fractions import Fraction
from math import comb

import msgspec
import pytest
from certificates import campaign, made
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom, hypergeom

from conductor.certify.audit import AuditOptions, audit
from conductor.certify.comparing import compared, lines
from conductor.certify.draw import bound, checked_seed, draw, false_at_most
from conductor.certify.rows import Row
from conductor.records.outcomes import CaseOutcome, Outcomes
from twin.base.errors import TwinError, UsageError

ROOT = "ab" * 32
NAMES = [f"case-{number}" for number in range(2000)]
TRIALS = 1000


def test_anybody_draws_the_same_with_sha256sum():
    places = {}
    for name in NAMES[:20]:
        text = f"drivetwin audit 1\n{ROOT}\nlotto 3 7 12\n{name}\n"
        done = subprocess.run(["sha256sum"], input=text.encode(), capture_output=True, check=True)
        places[name] = done.stdout.split()[0]
    assert draw(ROOT, "lotto 3 7 12", NAMES[:20], 5) == sorted(places, key=places.__getitem__)[:5]


def test_a_draw_is_without_replacement_and_larger_ones_hold_it():
    few, many = draw(ROOT, "s", NAMES, 30), draw(ROOT, "s", NAMES, 300)
    assert many[:30] == few
    assert len(set(many)) == 300
    assert sorted(draw(ROOT, "s", NAMES, 10**6)) == sorted(NAMES)


def test_seed_and_table_decide_it_and_the_order_of_names_does_not():
    first = draw(ROOT, "s", NAMES, 50)
    assert draw(ROOT, "s", NAMES[::-1], 50) == first
    assert draw(ROOT, "t", NAMES, 50) != first
    assert draw("cd" * 32, "s", NAMES, 50) != first


@pytest.mark.parametrize("seed", ["", " a", "a\n", "a\tb", "ä", "x" * 201])
def test_seeds_that_cannot_be_typed_again(seed):
    with pytest.raises(UsageError, match="--seed"):
        checked_seed(seed)


@given(st.integers(1, 400), st.data())
def test_the_bound_is_the_exact_hypergeometric_one(rows, data):
    drawn = data.draw(st.integers(0, rows))
    most = false_at_most(rows, drawn)

    def unseen(false):
        return Fraction(comb(rows - false, drawn), comb(rows, drawn))

    assert unseen(most) > Fraction(5, 100)
    assert most + drawn == rows or unseen(most + 1) <= Fraction(5, 100)


@pytest.mark.parametrize(("rows", "drawn"), [(300, 60), (1000, 299), (100_000, 300)])
def test_the_bound_agrees_with_scipy(rows, drawn):
    most = false_at_most(rows, drawn)
    assert hypergeom.pmf(0, rows, most, drawn) > 0.05 > hypergeom.pmf(0, rows, most + 1, drawn)


def test_what_is_said_of_the_table():
    assert bound(100_000, 300) == (
        "with 95 % confidence fewer than 993 of 100000 rows are false (less than 1.00 %)"
    )
    assert bound(50, 50) == "no row of 50 is false: all were run again"


def outcomes(rows: list[Row]) -> Outcomes:
    """What cases come to when they are run again and their rows tell the truth."""
    cases = {}
    for row in rows:
        outcome, _, verdict = row.outcome.partition("/")
        device = "cpu:x86_64+avx2+fma" if row.device == 0 else "cuda:NVIDIA H200"
        cases[row.case] = CaseOutcome(
            passed=verdict == "pass",
            outcome=outcome,
            verdict=verdict,
            kpi_sha256=row.kpi,
            device_class=device,
        )
    return Outcomes(
        campaign="table",
        digest="",
        seed=0,
        simulator="noop",
        software="",
        device="any",
        device_classes=[],
        complete=True,
        cases=cases,
    )


@pytest.mark.parametrize("share", [0.003, 0.01, 0.03])
def test_false_rows_are_found_as_often_as_they_must_be(share):
    """1,000 tables of 2,000 rows with k of them false, an audit of 100 cases each: the draw and the
    comparison are the audit's own; what running a case again comes to is the true row."""
    certificate = made(campaign(2000))
    truth = outcomes(certificate.rows)
    count = round(share * len(certificate.rows))
    found = 0
    for trial in range(TRIALS):
        forged, chosen = list(certificate.rows), set()
        for place in random.Random(trial).sample(range(len(forged)), count):
            row = forged[place]
            lie = hashlib.sha256(f"{trial} {row.case}".encode()).hexdigest()
            forged[place] = Row(row.case, row.outcome, lie, row.device)
            chosen.add(row.case)
        drawn = draw(f"{trial:064x}", f"public {trial}", list(truth.cases), 100)
        audited = compared(_with_rows(certificate, forged), drawn, "s", truth)
        assert audited.count("false") == len(chosen.intersection(drawn))
        found += audited.exit_code == 1
    expected = 1 - hypergeom.pmf(0, 2000, count, 100)
    low, high = binom.interval(0.999, TRIALS, expected)
    assert low <= found <= high, (found, low, high)
    print(f"{share:.1%} false: found in {found} of {TRIALS}, expected {expected * TRIALS:.0f}")


def _with_rows(certificate, rows):
    """The table alone: what is compared knows no signature."""
    return msgspec.structs.replace(certificate, rows=rows)


def test_a_difference_says_both_values_and_gives_no_bound():
    certificate = made()
    here = outcomes(certificate.rows)
    name = certificate.rows[0].case
    changed = _with_rows(
        certificate,
        [Row(name, "verdict/collision", "1" * 64, 0), *certificate.rows[1:]],
    )
    audited = compared(changed, list(here.cases), "s", here)
    assert (audited.exit_code, audited.bound) == (1, "")
    (finding,) = [each for each in audited.findings if each.kind == "false"]
    kpi = certificate.rows[0].kpi[:12]
    assert (
        finding.words == f"verdict/collision against verdict/pass, KPIs 111111111111 against {kpi}"
    )
    assert audited.words == "false: 1 of 8 cases drawn came to something else here"


def test_another_device_class_decides_nothing_and_is_counted_apart():
    certificate = made()
    other = [Row(row.case, row.outcome, "2" * 64, 1) for row in certificate.rows]
    audited = compared(certificate, [row.case for row in other], "s", outcomes(other))
    assert (audited.count("undecided"), audited.count("false")) == (8, 0)
    assert (audited.exit_code, audited.bound) == (3, "")
    same = [Row(row.case, row.outcome, row.kpi, 1) for row in certificate.rows]
    assert compared(certificate, [row.case for row in same], "s", outcomes(same)).exit_code == 0


def test_portable_rows_are_false_wherever_they_came_to_something_else():
    """No device excuses them; results of a machine of another class decide nothing, as ever."""
    in_truth = made()
    head = in_truth.head
    made_in = msgspec.structs.replace(head.made_in, device_classes=["portable"])
    certificate = msgspec.structs.replace(
        in_truth, head=msgspec.structs.replace(head, made_in=made_in)
    )
    names = [row.case for row in certificate.rows]
    here = outcomes([Row(row.case, row.outcome, "2" * 64, 0) for row in certificate.rows])
    portable = {
        name: msgspec.structs.replace(case, device_class="portable")
        for name, case in here.cases.items()
    }
    audited = compared(certificate, names, "s", msgspec.structs.replace(here, cases=portable))
    assert (audited.count("false"), audited.exit_code) == (8, 1)
    assert compared(certificate, names, "s", here).count("undecided") == 8


def test_rows_without_a_result_are_told_and_never_drawn(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rows = made().rows
    left = [msgspec.structs.replace(row, outcome="unresolved", kpi="", device=-1) for row in rows]
    options = AuditOptions(cases=8, seed="s")
    with pytest.raises(UsageError, match="no row of it has a result"):
        audit(made(rows=left), "c.cert", options, lambda _plan, _folder: 0)
    table = made(rows=[*left[:5], *rows[5:]])
    ran: list[str] = []

    def run_cases(plan, folder):
        ran.extend(case.id for case in plan.cases)
        return 75

    assert audit(table, "c.cert", options, run_cases) == 75
    assert ran == [row.case for row in rows[5:]]
    audited = compared(table, ran, "s", outcomes(rows))
    assert (audited.rows, audited.without_result, audited.exit_code) == (3, 5, 0)
    assert lines(audited, 20)[-1].startswith("5 rows without a result: nothing is claimed")


def test_an_audit_leaves_other_folders_and_other_audits_alone(tmp_path):
    (tmp_path / "notes").write_text("mine")
    options = AuditOptions(cases=2, seed="s", out=tmp_path)
    with pytest.raises(UsageError, match="holds something, and no audit"):
        audit(made(), "c.cert", options, lambda _plan, _folder: 75)
    assert [path.name for path in tmp_path.iterdir()] == ["notes"]
    out = tmp_path / "audit"
    first = AuditOptions(cases=2, out=out)
    drawn: list[list[str]] = []

    def run_cases(plan, _folder):
        drawn.append([case.id for case in plan.cases])
        return 75

    assert audit(made(), "c.cert", first, run_cases) == 75
    assert audit(made(), "c.cert", first, run_cases) == 75
    assert drawn[0] == drawn[1], "the seed that was drawn is kept"
    for other in (AuditOptions(cases=3, out=out), AuditOptions(cases=2, seed="t", out=out)):
        with pytest.raises(UsageError, match="holds an audit of 2 cases by seed"):
            audit(made(), "c.cert", other, run_cases)
    with pytest.raises(UsageError, match="holds an audit of 2 cases by seed"):
        audit(made(campaign(9)), "c.cert", first, run_cases)
    for bad in ("", "{}", "[" * 9999, "x" * (1 << 17)):
        (out / "audit.json").write_text(bad)
        with pytest.raises(TwinError, match=r"audit\.json"):
            audit(made(), "c.cert", first, run_cases)


def test_a_case_that_comes_to_no_result_here_decides_nothing():
    certificate = made()
    lost = [Row(row.case, "unresolved", "", -1) for row in certificate.rows]
    audited = compared(certificate, [row.case for row in lost], "s", outcomes(lost))
    assert (audited.count("not run"), audited.exit_code) == (8, 3)
