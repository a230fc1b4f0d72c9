"""Where the nodes of a rig meet the bridge, and what their environment says of it.

rmw_zenoh's packages are built with TCP, UDP and TLS, and without Unix sockets. So nodes come by TCP
where no other process can, in a network of their rig's own, and by TLS everywhere else: with a key
of this rig that nobody else gets, because every user of a host reaches its loopback.
"""

from __future__ import annotations

import json
import os
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import IO

from twin.base.errors import UsageError
from twin.base.files import write_atomic
from twin.fabric.keys.authority import rig_keys
from twin.fabric.keys.key_file import MemberKey, as_key

OWN_NETWORK = "tcp/127.0.0.1:7447"
"""Endpoint in a network of the rig's own: where nodes of rmw_zenoh look if nobody tells them."""

SHARED_NETWORK = "tls/127.0.0.1"
"""Endpoint, without its port, in a network that others share."""


FILES = {
    "root_ca_certificate": "authority.pem",
    "connect_certificate": "node.pem",
    "connect_private_key": "node.key",
}
"""Zenoh's options of TLS -> names of the files in a folder of keys."""

SETTINGS = "node.env"
"""Its file of variables, for ``source``."""


class MeetingPlace:
    """An endpoint, and what a node needs to reach it; open until it is closed."""

    def __init__(
        self,
        rig: str,
        *,
        own_network: bool,
        folder: Path | None = None,
        port: int = 0,
        shared_memory: bool = False,
    ) -> None:
        """Choose the endpoint, and make keys if it needs them.

        Args:
            rig: its name.
            own_network: no process but those of the rig reaches this host's loopback.
            folder: where keys are written, for nodes that somebody else starts; None: nowhere.
            port: of an endpoint in a shared network; 0: a free one.
            shared_memory: large messages may lie in memory that both sides see.

        Raises:
            UsageError: the folder cannot be written to.
        """
        self.listen = OWN_NETWORK if own_network else f"{SHARED_NETWORK}:{port}"
        self.shared_memory = shared_memory
        self.key: MemberKey | None = None
        """Key of the bridge; None: the endpoint needs none."""
        self._files: dict[str, IO[bytes]] = {}
        self._paths: dict[str, str] = {}
        self._folder = folder
        self._written: list[Path] = []
        if own_network:
            return
        ours, theirs = rig_keys(rig)
        self.key = as_key(Path("/bridge.key"), ours)
        node = as_key(Path("/node.key"), theirs)
        parts = (node.authority, node.certificate, node.private)
        for name, data in zip(FILES, parts, strict=True):
            if folder is None:
                self._files[name] = _unnamed(data)
                self._paths[name] = f"/proc/{os.getpid()}/fd/{self._files[name].fileno()}"
            else:
                self._paths[name] = str(self._write(folder / FILES[name], data))

    def close(self) -> None:
        """Forget the keys."""
        while self._files:
            self._files.popitem()[1].close()
        while self._written:
            self._written.pop().unlink(missing_ok=True)

    def variables(self, endpoint: str, domain: int) -> dict[str, str]:
        """Variables for the environment of nodes; also written to the folder of keys.

        Args:
            endpoint: where the session listens, with its real port.
            domain: number of the ROS 2 domain.
        """
        options: dict[str, object] = {"connect/endpoints": [endpoint]}
        if self._paths:
            # Clients listen nowhere: in a shared network, a node's own port would be open to all.
            options["mode"] = "client"
            options |= {f"transport/link/tls/{name}": path for name, path in self._paths.items()}
            options["transport/link/tls/enable_mtls"] = True
            options["transport/link/tls/verify_name_on_connect"] = False
        if self.shared_memory:
            # Nodes read what lies there, and put nothing of their own beside it: it is small.
            options["transport/shared_memory/enabled"] = True
            options["transport/shared_memory/transport_optimization/enabled"] = False
        variables = {
            "RMW_IMPLEMENTATION": "rmw_zenoh_cpp",
            "ROS_DOMAIN_ID": str(domain),
            "ZENOH_CONFIG_OVERRIDE": config_override(options),
        }
        if self._folder is not None:
            lines = [f"export {name}={shlex.quote(value)}" for name, value in variables.items()]
            self._write(self._folder / SETTINGS, "\n".join([*lines, ""]).encode())
        return variables

    def _write(self, path: Path, data: bytes) -> Path:
        path = path.absolute()
        try:
            path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            write_atomic(path, data, mode=0o600)
        except OSError as error:
            raise UsageError(
                f"autonomy.parameters.keys: {path}: {error.strerror}; give a folder of your own"
            ) from None
        self._written.append(path)
        return path


def config_override(options: Mapping[str, object]) -> str:
    """A value of ``ZENOH_CONFIG_OVERRIDE``: ``path=value`` in JSON5, separated by semicolons."""
    return ";".join(f"{path}={json.dumps(value)}" for path, value in options.items())


def _unnamed(data: bytes) -> IO[bytes]:
    """A file of mode 0600 in memory: gone with this process however it ends."""
    file = os.fdopen(os.memfd_create("ros2 key", os.MFD_CLOEXEC), "wb", buffering=0)
    os.fchmod(file.fileno(), 0o600)
    file.write(data)
    return file
