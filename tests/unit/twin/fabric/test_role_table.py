"""The table of roles without a session: what follows from it, word for word.

That Zenoh keeps to it is in ``test_security_roles``.
"""

import pytest

from schemas.wire import topics
from twin.fabric.keys.rights import MAY, Act, access_control, may, pattern, refusal
from twin.fabric.keys.roles import Role, common_name, fabric_of_rig, rig_of, split_name


@pytest.fixture(autouse=True)
def _nothing_remembered():
    """What is allowed is remembered for the whole process."""
    may.cache_clear()


FLOWS = {
    Act.publish: ({"put", "delete"}, {"declare_subscriber"}),
    Act.subscribe: ({"declare_subscriber"}, {"put", "delete"}),
    Act.ask: ({"query"}, {"reply", "declare_queryable"}),
    Act.answer: ({"declare_queryable", "reply"}, {"query"}),
    Act.announce: ({"liveliness_token"}, {"liveliness_query", "declare_liveliness_subscriber"}),
    Act.watch: ({"liveliness_query", "declare_liveliness_subscriber"}, {"liveliness_token"}),
}
"""Zenoh's messages from whoever does it, and to them."""


@pytest.mark.parametrize("namespace", ["twin/rig", "a"])
def test_every_rule_is_about_one_namespace(namespace):
    """The conductor alone has none: a relay passes on for others."""
    rules = access_control("ours", namespace, plain=False)["rules"]
    below = {role: set() for role in Role}
    for rule in rules:
        below[Role(rule["id"].partition(" ")[0])].update(rule["key_exprs"])
    assert below.pop(Role.conductor) == {"**"}
    for role, key_expressions in below.items():
        allowed = {f"{namespace}/{key}" for keys in MAY[role].values() for key in keys}
        assert key_expressions == allowed, role


@pytest.mark.parametrize("plain", [False, True])
def test_the_access_list_lets_each_certificate_do_what_its_role_may(plain):
    made = access_control("ours", "twin", plain=plain)
    assert (made["enabled"], made["default_permission"]) == (True, "deny")
    rules = {rule["id"]: rule for rule in made["rules"]}
    assert len(rules) == len(made["rules"])
    for role in Role:
        for act in MAY[role]:
            for flow, messages in zip(("ingress", "egress"), FLOWS[act], strict=True):
                rule = rules.pop(f"{role} {act} {flow}")
                assert rule["permission"] == "allow"
                assert (rule["flows"], set(rule["messages"])) == ([flow], messages)
    assert not rules, "and nothing else"
    own = [{"id": str(r), "cert_common_names": [f"ours {r}"]} for r in Role]
    local = [{"id": "this host", "link_protocols": ["tcp"]}]
    assert made["subjects"] == own + (local if plain else [])
    for role, policy in zip(Role, made["policies"], strict=True):
        more = ["this host"] if plain and role is Role.conductor else []
        assert policy["subjects"] == [str(role), *more]
        flows = ("ingress", "egress")
        assert policy["rules"] == [f"{role} {act} {flow}" for act in MAY[role] for flow in flows]


@pytest.mark.parametrize(
    ("role", "act", "key", "allowed"),
    [
        (Role.conductor, Act.ask, "any/key/at/all", True),
        (Role.conductor, Act.publish, "**", True),
        (Role.worker, Act.ask, "conductor/rpc/worker", True),
        (Role.worker, Act.ask, "conductor/rpc", False),
        (Role.worker, Act.ask, "conductor/rpc/worker/x", False),
        (Role.worker, Act.ask, "conductor/rpc/admin", False),
        (Role.admin, Act.ask, "conductor/rpc/admin", True),
        (Role.admin, Act.ask, "conductor/rpc/submit", False),
        (Role.admin, Act.ask, "conductor/rpc/*", False),
        (Role.submitter, Act.ask, "conductor/rpc/submit", True),
        (Role.submitter, Act.ask, "conductor/rpc/admin", False),
        (Role.submitter, Act.ask, "view/a/b/control", False),
        (Role.worker, Act.publish, "drive/x/tick", True),
        (Role.worker, Act.publish, "drive/*/tick", True),
        (Role.worker, Act.publish, "drive/**/tick", False),
        (Role.worker, Act.publish, "drive/x/*", False),
        (Role.viewer, Act.subscribe, "view/a/b/live/*", True),
        (Role.viewer, Act.subscribe, "view/a/b/live/camera", True),
        (Role.viewer, Act.subscribe, "view/a/b/live/**", False),
        (Role.viewer, Act.publish, "view/a/b/live/camera", False),
        (Role.stack, Act.announce, "drive/x/alive", False),
        (Role.stack, Act.watch, "drive/x/alive", True),
    ],
)
def test_a_key_is_allowed_as_a_whole(role, act, key, allowed):
    assert may(role, act, key) is allowed


def test_a_pattern_has_a_star_for_every_name():
    assert pattern(topics.VIEW_LIVE_STATE) == "view/*/*/live/state"
    assert pattern(topics.EVENT) == "conductor/event"


def test_names_of_certificates():
    assert common_name("lab 7", Role.viewer) == "lab 7 viewer"
    assert split_name("lab 7 viewer") == ("lab 7", Role.viewer)
    for name in ("lab 7", "viewer lab", ""):
        with pytest.raises(ValueError, match="is not a valid Role"):
            split_name(name)
    assert rig_of(fabric_of_rig("abc")) == "abc"
    assert rig_of("lab 7") == ""
    assert fabric_of_rig("abc") != fabric_of_rig("abd")


@pytest.mark.parametrize(
    ("role", "act", "key", "said"),
    [
        (
            Role.stack,
            Act.ask,
            topics.RPC_STATUS.key,
            "a key of role stack may not ask conductor/rpc/status, allowed: viewer or worker or "
            "admin or submitter; ask for one by `conductor invite --role viewer`",
        ),
        (
            Role.worker,
            Act.publish,
            "drive/x/command",
            "a key of role worker may not publish on drive/x/command, allowed: stack; "
            "its rig gives it that one",
        ),
        (
            Role.viewer,
            Act.answer,
            "conductor/rpc/status",
            "a key of role viewer may not answer on conductor/rpc/status, allowed: conductor; "
            "give that one",
        ),
        (
            Role.viewer,
            Act.watch,
            "feed/x/recorder",
            "a key of role viewer may not watch feed/x/recorder, allowed: worker; "
            "ask for one by `conductor invite --role worker`",
        ),
        (
            Role.stack,
            Act.announce,
            "drive/x/alive",
            "a key of role stack may not announce itself on drive/x/alive, allowed: worker; "
            "ask for one by `conductor invite --role worker`",
        ),
        (
            Role.worker,
            Act.subscribe,
            "conductor/event",
            "a key of role worker may not listen on conductor/event, allowed: viewer or admin or "
            "submitter; ask for one by `conductor invite --role viewer`",
        ),
    ],
)
def test_a_refusal_names_the_least_role_that_is_enough(role, act, key, said):
    assert refusal(role, act, key) == said
