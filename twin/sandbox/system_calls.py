"""System calls that nothing in a sandbox may make, as a seccomp filter for ``bwrap --seccomp``.

A filter is a program of classic BPF over ``struct seccomp_data`` (number, architecture, arguments).
What stands here reaches other processes, the kernel's own machinery, or makes namespaces, in which
a process has powers again that it had lost.
"""

from __future__ import annotations

import struct

_LOAD, _JUMP_IF_EQUAL, _JUMP_IF_ANY_BIT, _JUMP_IF_AT_LEAST, _RETURN = 0x20, 0x15, 0x45, 0x35, 0x06
_NUMBER, _MACHINE, _FIRST_LOW, _SECOND_LOW = 0, 4, 16, 24
"""Offsets in ``struct seccomp_data`` on little-endian machines [bytes]."""
_ALLOW, _KILL, _ERRNO = 0x7FFF0000, 0x80000000, 0x00050000
_EPERM, _ENOSYS = 1, 38

NEW_NAMESPACES = 0x7E020000
"""``CLONE_NEW*`` except ``CLONE_NEWTIME``, which ``clone`` does not take."""

TERMINAL_REQUESTS = (0x5412, 0x541C)
"""``TIOCSTI`` and ``TIOCLINUX``: type into the terminal of whoever started the sandbox."""

DENIED: dict[str, tuple[int, int]] = {
    "ptrace": (101, 117),
    "process_vm_readv": (310, 270),
    "process_vm_writev": (311, 271),
    "pidfd_getfd": (438, 438),
    "kcmp": (312, 272),
    "keyctl": (250, 219),
    "add_key": (248, 217),
    "request_key": (249, 218),
    "bpf": (321, 280),
    "perf_event_open": (298, 241),
    "userfaultfd": (323, 282),
    "io_uring_setup": (425, 425),
    "io_uring_enter": (426, 426),
    "io_uring_register": (427, 427),
    "kexec_load": (246, 104),
    "kexec_file_load": (320, 294),
    "init_module": (175, 105),
    "finit_module": (313, 273),
    "delete_module": (176, 106),
    "reboot": (169, 142),
    "swapon": (167, 224),
    "swapoff": (168, 225),
    "acct": (163, 89),
    "syslog": (103, 116),
    "quotactl": (179, 60),
    "name_to_handle_at": (303, 264),
    "open_by_handle_at": (304, 265),
}
"""Name -> number on x86-64 and on aarch64."""

MOUNTING: dict[str, tuple[int, int]] = {
    "mount": (165, 40),
    "umount2": (166, 39),
    "pivot_root": (155, 41),
    "chroot": (161, 51),
    "unshare": (272, 97),
    "setns": (308, 268),
    "open_tree": (428, 428),
    "move_mount": (429, 429),
    "fsopen": (430, 430),
    "fsconfig": (431, 431),
    "fsmount": (432, 432),
    "fspick": (433, 433),
    "mount_setattr": (442, 442),
}
"""The same, of what makes namespaces and mounts in them: a container runtime does that."""

_CLONE, _CLONE3, _IOCTL, _KILL_CALL = (56, 220), (435, 435), (16, 29), (62, 129)
_EVERYBODY = 0xFFFFFFFF
"""-1, the process number by which ``kill`` means all."""
_X32_BIT = 0x40000000
"""Numbers of x86-64's other table."""

MACHINES: dict[str, tuple[int, int]] = {"x86_64": (0, 0xC000003E), "aarch64": (1, 0xC00000B7)}
"""Name as ``uname`` says it -> column of the tables, and ``AUDIT_ARCH_*``."""


def filter_of(machine: str, *, containers: bool = False) -> bytes | None:
    """The filter for programs of ``machine``; None: its system calls are not known here.

    ``containers``: a container runtime may make namespaces and mounts of its own.
    """
    if machine not in MACHINES:
        return None
    column, architecture = MACHINES[machine]
    refuse = _step(_RETURN, _ERRNO | _EPERM)
    program = [
        _step(_LOAD, _MACHINE),
        _step(_JUMP_IF_EQUAL, architecture, 1, 0),
        _step(_RETURN, _KILL),
        _step(_LOAD, _NUMBER),
    ]
    if machine == "x86_64":
        program += [_step(_JUMP_IF_AT_LEAST, _X32_BIT, 0, 1), refuse]
    for numbers in (DENIED if containers else DENIED | MOUNTING).values():
        program += [_step(_JUMP_IF_EQUAL, numbers[column], 0, 1), refuse]
    if not containers:
        # Flags of clone3 lie in memory, where no filter sees them; libraries then call clone.
        program += [
            _step(_JUMP_IF_EQUAL, _CLONE3[column], 0, 1),
            _step(_RETURN, _ERRNO | _ENOSYS),
            _step(_JUMP_IF_EQUAL, _CLONE[column], 0, 4),
            _step(_LOAD, _FIRST_LOW),
            _step(_JUMP_IF_ANY_BIT, NEW_NAMESPACES, 0, 1),
            refuse,
            _step(_RETURN, _ALLOW),
        ]
    # Where it shares its processes with the host, that would be all of its user's.
    program += [
        _step(_JUMP_IF_EQUAL, _KILL_CALL[column], 0, 4),
        _step(_LOAD, _FIRST_LOW),
        _step(_JUMP_IF_EQUAL, _EVERYBODY, 0, 1),
        refuse,
        _step(_RETURN, _ALLOW),
    ]
    program += [
        _step(_JUMP_IF_EQUAL, _IOCTL[column], 0, 2 + len(TERMINAL_REQUESTS)),
        _step(_LOAD, _SECOND_LOW),
        _step(_JUMP_IF_EQUAL, TERMINAL_REQUESTS[0], 1, 0),
        _step(_JUMP_IF_EQUAL, TERMINAL_REQUESTS[1], 0, 1),
        refuse,
        _step(_RETURN, _ALLOW),
    ]
    return b"".join(program)


def _step(code: int, value: int, if_true: int = 0, if_false: int = 0) -> bytes:
    """One ``struct sock_filter``."""
    return struct.pack("<HBBI", code, if_true, if_false, value)
