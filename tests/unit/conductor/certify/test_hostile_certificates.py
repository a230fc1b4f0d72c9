"""Certificates of somebody who is trusted to sign, and who writes what he likes: nothing of them is
run, read or written on the auditor's machine before he has said so."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import msgspec
import pytest
from certificates import campaign, made

from conductor.certify.audit import AuditOptions, audit
from conductor.certify.consent import SHIPPED_STACKS, Consent, require_consent
from conductor.certify.subject import plan_in, prepared
from conductor.run.source import load, shipped
from schemas.files.assets import asset_digest
from twin.base.errors import TwinError, UsageError


def simulated(**changed: Any) -> dict[str, Any]:
    """A campaign of the simulator, with a shipped stack."""
    return campaign(2, simulator="warp", **changed)


def refusal(data: dict[str, Any], consent: Consent | None = None, **said: Any) -> str:
    """The one line by which an audit refuses a certificate of a campaign; no case is run."""
    ran: list[Path] = []

    def run_cases(_plan: object, folder: Path) -> int:
        ran.append(folder)
        return 0

    options = AuditOptions(cases=1, seed="s", consent=consent or Consent())
    with pytest.raises(TwinError) as caught:
        audit(made(data, **said), "c.cert", options, run_cases)
    assert not ran
    assert not Path("runs").exists()
    assert len(str(caught.value).splitlines()) == 1
    return str(caught.value)


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    """An audit without --out writes below the current folder."""
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def touching(tmp_path):
    """A command that leaves a trace."""
    return ["/bin/sh", "-c", f"touch {tmp_path}/RAN"]


def test_a_command_is_shown_and_not_run(tmp_path, touching):
    words = refusal(simulated(autonomy={"command": touching}))
    assert f"would run the command `/bin/sh -c 'touch {tmp_path}/RAN'` on this machine" in words
    assert "give --run-stack" in words
    assert not (tmp_path / "RAN").exists()


def test_a_repository_is_shown_and_not_fetched(tmp_path, touching):
    repository = {"url": f"file://{tmp_path}/repo", "ref": "main", "setup": "make all"}
    words = refusal(simulated(autonomy={"command": touching, "repository": repository}))
    assert f"of file://{tmp_path}/repo at main after `make all` on this machine" in words
    assert not (tmp_path / "RAN").exists()


@pytest.mark.parametrize(
    "stack",
    [
        "subprocess:Popen",
        "os:system",
        "devkit.hosting.foreign:Popen",
        "devkit.bridges:ScriptBridge",
        "my_stack:Mine",
    ],
)
def test_a_class_that_is_no_stack_of_ours_is_not_loaded(stack):
    words = refusal(simulated(autonomy={"stack": stack, "parameters": {"args": "touch RAN"}}))
    assert f"would run the stack {stack} on this machine" in words


def test_nodes_that_somebody_starts_at_a_bridge_need_the_auditors_word():
    alone = {"bridge": "ros2", "parameters": {"keys": "keys"}, "sandbox": "off"}
    words = refusal(simulated(autonomy=alone))
    assert "would run nodes that somebody else starts, behind the bridge ros2, on this ma" in words
    assert "give --run-stack" in words


def test_control_characters_of_a_command_are_escaped():
    words = refusal(simulated(autonomy={"command": ["/bin/sh", "\x1b[2J\nconductor: holds"]}))
    assert words.isprintable()


def test_stacks_of_shipped_campaigns_run_without_asking():
    plans = [load(name) for name in shipped()]
    assert {plan.campaign.autonomy.stack for plan in plans} <= SHIPPED_STACKS
    for plan in plans:
        require_consent(plan, Consent(), "c.cert")


@pytest.mark.parametrize("placement", ["inline", "node"])
def test_no_sandbox_no_run(placement):
    words = refusal(simulated(autonomy={"placement": placement}))
    assert "would run without a sandbox" in words
    assert "give --allow-unprotected" in words


def test_a_sandbox_is_there_though_the_campaign_wants_none():
    certificate = made(simulated(autonomy={"sandbox": "off"}))
    plan = plan_in(certificate, "c.cert")
    contained = prepared(certificate, plan, Consent(), "c.cert").campaign
    assert (contained.autonomy.sandbox, contained.view) == ("default", "none")
    told = prepared(certificate, plan, Consent(unprotected=True), "c.cert").campaign
    assert told.autonomy.sandbox == "off"


@pytest.mark.parametrize(
    "place", ["/etc/passwd.yaml", "../../up.yaml", "a/../../b.yaml", "//x.yaml"]
)
@pytest.mark.parametrize("field", ["scene", "vehicle"])
def test_a_path_without_a_digest_is_no_file(tmp_path, place, field):
    words = refusal(simulated(scenario={field: place}), Consent(files=tmp_path))
    assert f"names the file {place}, of which it has no digest" in words


def test_paths_of_a_certificate_are_not_opened(tmp_path):
    """The file lies where the certificate says, with the content that it says: it counts only from
    the folder that the auditor gives."""
    scene = tmp_path / "scene.yaml"
    scene.write_text("not: a scene\n")
    data = simulated(scenario={"scene": str(scene)}, files={str(scene): asset_digest(scene)})
    scene.unlink()
    os.mkfifo(scene)  # whoever opens it waits for ever
    (tmp_path / "empty").mkdir()
    for consent in (Consent(), Consent(files=tmp_path / "empty")):
        assert "a file is" in refusal(data, consent)


def test_files_are_found_by_content_whatever_they_are_called(tmp_path):
    data = load("aeb-demo").campaign
    scene = tmp_path / "mine.yaml"
    shipped_scene = Path(__file__).parents[4] / "twin/world/scenes" / f"{data.scenario.scene}.yaml"
    scene.write_text(shipped_scene.read_text())
    plain = simulated(
        scenario={"scene": "/nowhere/scene.yaml"},
        files={"/nowhere/scene.yaml": asset_digest(scene)},
    )
    certificate = made(plain)
    plan = plan_in(certificate, "c.cert")
    ready = prepared(certificate, plan, Consent(files=tmp_path), "c.cert")
    assert {case.rig.scene for case in ready.cases} == {str(scene)}
    scene.write_text(scene.read_text() + "# changed\n")
    with pytest.raises(UsageError, match=r"a file is not in .* whose digest is"):
        prepared(certificate, plan, Consent(files=tmp_path), "c.cert")


def test_files_on_an_axis_keep_their_paths(tmp_path):
    """The paths are parts of the names of cases."""
    there, other = tmp_path / "there", tmp_path / "other"
    there.mkdir()
    other.mkdir()
    shipped_scene = Path(__file__).parents[4] / "twin/world/scenes/downtown.yaml"
    scene = there / "town.yaml"
    scene.write_text(shipped_scene.read_text())
    data = simulated(
        matrix={"scenario.scene": [str(scene), "downtown"]},
        files={str(scene): asset_digest(scene)},
    )
    certificate = made(data)
    plan = plan_in(certificate, "c.cert")
    (other / "a.yaml").write_text(scene.read_text())
    with pytest.raises(UsageError, match=f"put the file at {scene}, and give its folder"):
        prepared(certificate, plan, Consent(files=other), "c.cert")
    ready = prepared(certificate, plan, Consent(files=tmp_path), "c.cert")
    assert {case.rig.scene for case in ready.cases} == {str(scene), "downtown"}


def test_parameters_do_not_lead_to_the_auditors_files(tmp_path):
    secret = tmp_path / "secret"
    secret.write_text("s")
    words = refusal(simulated(autonomy={"parameters": {"weights": str(secret)}}))
    assert f"the file {secret}, which a parameter names, is another one here" in words
    axis = {"autonomy.parameters.weights": [str(secret)]}
    assert str(secret) in refusal(simulated(matrix=axis))


@pytest.mark.parametrize("name", ["../x", "/etc", "", "A", "x" * 300, "a\nb"])
def test_names_of_folders_are_names(name):
    certificate = made(campaign())
    data = json.loads(certificate.campaign) | {"campaign": name}
    assert "its campaign" in refusal_of(certificate, data)


def test_a_case_cannot_be_named_out_of_its_folder():
    odd = campaign(matrix={"weather": ["clear"], "scenario.type": ["../../up", "jump_scare"]})
    certificate = made(campaign())
    assert "its campaign" in refusal_of(certificate, odd)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ([], "its campaign"),
        ({"campaign": "table"}, "its campaign"),
        (campaign(matrix={f"a{n}": list(range(1000)) for n in range(20)}), "its campaign"),
        (campaign(8, cases=[{}] * 100_001), "at most 100000"),
        (campaign(9), "is not the one whose rows it has"),
        (campaign(8, seed=1), "is not the one whose rows it has"),
        (campaign(8, campaign="other"), "its campaign 'other' is not the one whose rows it has"),
    ],
)
def test_another_campaign_is_refused(data, words):
    assert words in refusal_of(made(), data)


def refusal_of(certificate, data):
    """How an audit refuses a certificate with this campaign in it, bound by digest as the signer
    may do."""
    swapped = msgspec.structs.replace(certificate, campaign=msgspec.json.encode(data))
    with pytest.raises(TwinError) as caught:
        plan_in(swapped, "c.cert")
    assert len(str(caught.value).splitlines()) == 1
    return str(caught.value)


def test_other_software_is_refused():
    assert "made with software 111111111111, this is" in refusal(campaign(), software="1" * 64)


def test_plans_of_certificates_need_the_cases_of_their_rows():
    rows = made().rows
    more = msgspec.structs.replace(rows[0], case="aa")
    assert _of_rows(rows[1:]) == f"c.cert: {rows[0].case} has no row"
    assert _of_rows([*rows, more]) == "c.cert: aa has a row and is no case of its campaign"


def _of_rows(rows):
    with pytest.raises(TwinError) as caught:
        plan_in(made(rows=rows), "c.cert")
    return str(caught.value)
