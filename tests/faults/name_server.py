"""A name server that knows one name: `python name_server.py ADDRESS NAME` answers ADDRESS."""

from __future__ import annotations

import socket
import struct
import sys

TTL_S = 0
"""Nobody keeps the answer, so that a server that is gone is missed."""


def answer(question: bytes, name: str, address: str) -> bytes:
    """The reply to one query: an A record of ``name``, or that there is none."""
    end = question.index(b"\0", 12) + 5  # the name, then type and class
    labels, at = [], 12
    while question[at]:
        labels.append(question[at + 1 : at + 1 + question[at]].decode())
        at += 1 + question[at]
    (kind,) = struct.unpack_from("!H", question, end - 4)
    known = ".".join(labels) == name
    records = int(known and kind == 1)
    head = question[:2] + struct.pack("!5H", 0x8180 if known else 0x8183, 1, records, 0, 0)
    record = struct.pack("!HHHIH", 0xC00C, 1, 1, TTL_S, 4) + socket.inet_aton(address)
    return head + question[12:end] + record * records


if __name__ == "__main__":
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as server:
        server.bind((sys.argv[1], 53))
        print("ready", flush=True)
        while True:
            asked, who = server.recvfrom(512)
            server.sendto(answer(asked, sys.argv[2], sys.argv[1]), who)
