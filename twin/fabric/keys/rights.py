"""Rights on the fabric by role: one table, from which every session's access list is made.

A role stands in the certificate. Whoever receives a message decides by it, so a program that minds
no rule of ours gets no further than its certificate allows.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from enum import StrEnum
from functools import lru_cache
from typing import Any

from schemas.wire import topics
from schemas.wire.topics import Topic
from twin.fabric.keys.roles import INVITED, Role, common_name


class Act(StrEnum):
    """What may be done on a key."""

    publish = "publish"
    subscribe = "subscribe"
    ask = "ask"
    answer = "answer"
    announce = "announce"
    """Be seen alive."""
    watch = "watch"
    """See who is alive."""


def pattern(topic: Topic) -> str:
    """Every key of ``topic``, as a key expression."""
    return re.sub(r"\{\w+\}", "*", topic.key)


def _keys(*key_topics: Topic) -> tuple[str, ...]:
    return tuple(dict.fromkeys(map(pattern, key_topics)))


def _ready(side: str) -> str:
    return topics.READY.key.format(rig="*", side=side)


_SENSED = (topics.sensor_key("*", "*"), *_keys(topics.EPISODE, topics.TICK))
_SHOWN = _keys(
    *(
        topic
        for topic in topics.TOPICS
        if topic.key.startswith("view/") and topic is not topics.VIEW_CONTROL
    )
)
_TO_RECORDER = _keys(topics.FEED_RECORDED, topics.FEED_END)
_STACK = {
    Act.publish: (*_keys(topics.COMMAND), _ready("stack")),
    Act.subscribe: (*_SENSED, _ready("simulator")),
    Act.watch: _keys(topics.SIMULATOR_ALIVE),
}
_VIEWER = {
    Act.subscribe: (*_SHOWN, *_keys(topics.EVENT)),
    Act.ask: _keys(topics.RPC_STATUS, topics.CASE_FILES, topics.FEED_SCENE, topics.FEED_CLOCK),
}

MAY: dict[Role, dict[Act, tuple[str, ...]]] = {
    Role.conductor: dict.fromkeys(Act, ("**",)),
    Role.worker: {
        Act.publish: (*_SENSED, _ready("simulator"), *_SHOWN, *_TO_RECORDER),
        Act.subscribe: (
            *_keys(topics.COMMAND),
            *(_ready("stack"), *_TO_RECORDER),
        ),
        Act.ask: _keys(topics.RPC_WORKER, topics.RPC_STATUS, topics.FILES),
        Act.answer: _keys(
            *(topics.CONTROL, topics.VIEW_CONTROL, topics.FEED_SCENE, topics.FEED_CLOCK)
        ),
        Act.announce: _keys(topics.WORKER_ALIVE, topics.SIMULATOR_ALIVE, topics.RECORDER_ALIVE),
        Act.watch: _keys(topics.RECORDER_ALIVE),
    },
    Role.stack: _STACK,
    Role.viewer: _VIEWER,
    Role.admin: {
        Act.subscribe: _VIEWER[Act.subscribe],
        Act.ask: (*_VIEWER[Act.ask], *_keys(topics.RPC_ADMIN, topics.VIEW_CONTROL)),
    },
    Role.submitter: {
        Act.subscribe: _VIEWER[Act.subscribe],
        Act.ask: (*_VIEWER[Act.ask], *_keys(topics.RPC_SUBMIT)),
    },
}
"""Role -> act -> key expressions, below the session's namespace; what is not here is denied."""

_MESSAGES: dict[Act, tuple[tuple[str, ...], tuple[str, ...]]] = {
    Act.publish: (("put", "delete"), ("declare_subscriber",)),
    Act.subscribe: (("declare_subscriber",), ("put", "delete")),
    Act.ask: (("query",), ("reply", "declare_queryable")),
    Act.answer: (("declare_queryable", "reply"), ("query",)),
    Act.announce: (
        ("liveliness_token",),
        ("liveliness_query", "declare_liveliness_subscriber"),
    ),
    Act.watch: (
        ("liveliness_query", "declare_liveliness_subscriber"),
        ("liveliness_token",),
    ),
}
"""Act -> Zenoh's messages from whoever may do it, and to them."""

_NOT_ITS = {
    Act.publish: "publish on",
    Act.subscribe: "listen on",
    Act.ask: "ask",
    Act.answer: "answer on",
    Act.announce: "announce itself on",
    Act.watch: "watch",
}


@lru_cache(maxsize=4096)
def may(role: Role, act: Act, key: str) -> bool:
    """Whether ``role`` may do ``act`` on all of ``key``, which may hold wildcards."""
    return any(_includes(allowed, key) for allowed in MAY[role].get(act, ()))


def refusal(role: Role, act: Act, key: str) -> str:
    """Why it may not, and which role may: the end of a sentence."""
    # Nobody is told to ask for more than it takes.
    able = [other for other in INVITED if may(other, act, key)]
    remedy = f"ask for one by `conductor invite --role {able[0]}`" if able else "give that one"
    if may(Role.stack, act, key) and not able:
        able, remedy = [Role.stack], "its rig gives it that one"
    allowed = " or ".join(able) or Role.conductor
    return f"a key of role {role} may not {_NOT_ITS[act]} {key}, allowed: {allowed}; {remedy}"


def access_control(
    fabric: str,
    namespace: str,
    *,
    plain: bool = False,
    through: Mapping[str, Role] | None = None,
) -> dict[str, Any]:
    """Zenoh's access list of a session in ``namespace``.

    Zenoh trusts the public web's authorities beside ours when it connects, and host names are not
    checked; but no web certificate has a name of this fabric, and nobody else is let through.

    Args:
        fabric: first words of the members' certificates; empty: nobody shows one.
        namespace: prefix of every key.
        plain: the session has links of plain TCP on this host, too; they may do everything.
        through: kind of link -> role of all who come by it, whoever they are. In a rig's folder
            that is its stack; behind a front, whom the front let through.
    """
    rules: list[dict[str, Any]] = []
    subjects: list[dict[str, Any]] = []
    policies: dict[Role, dict[str, list[str]]] = {}
    for role in Role if fabric else dict.fromkeys((through or {}).values()):
        ids = []
        for act, keys in MAY[role].items():
            for flow, messages in zip(("ingress", "egress"), _MESSAGES[act], strict=True):
                ids.append(f"{role} {act} {flow}")
                rules.append(
                    {
                        "id": ids[-1],
                        "permission": "allow",
                        "flows": [flow],
                        "messages": list(messages),
                        # The conductor alone has no namespace: a relay passes on for others.
                        "key_exprs": [k if k == "**" else f"{namespace}/{k}" for k in keys],
                    }
                )
        policies[role] = {"rules": ids, "subjects": []}
        if fabric:
            subjects.append({"id": str(role), "cert_common_names": [common_name(fabric, role)]})
            policies[role]["subjects"].append(str(role))
    if plain:
        subjects.append({"id": "this host", "link_protocols": ["tcp"]})
        policies[Role.conductor]["subjects"].append("this host")
    for kind, role in (through or {}).items():
        subjects.append({"id": kind, "link_protocols": [kind]})
        policies[role]["subjects"].append(kind)
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": list(policies.values()),
    }


def _includes(allowed: str, key: str) -> bool:
    if allowed == "**":
        return True
    ours, theirs = allowed.split("/"), key.split("/")
    return len(ours) == len(theirs) and all(
        a == b or (a == "*" and b != "**") for a, b in zip(ours, theirs, strict=True)
    )
