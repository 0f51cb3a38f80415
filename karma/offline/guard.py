"""Nothing leaves this machine: the libraries' offline switches, and a guard over Python's sockets.

`go_offline()` is the first thing every entry point calls. The guard is an audit hook, so it sees
every connection, datagram, look-up and open port that Python code asks for, whichever library asks,
and cannot be taken off again. Not seen: what compiled code does past Python's `socket` module, and
other programs that are started; `scripts/airgap.sh` runs all where there is no interface.
"""

import atexit
import ipaddress
import os
import socket
import sys
import sysconfig
import threading
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any

from karma.errors import KarmaError

OFFLINE = "KARMA_OFFLINE"  # 1: this process and those it starts never get leave
HOSTED = "the hosted model"  # asks for the network, unless something else says so

# Python programs that are started import nothing from the folder that they stand in.
SAFE_PATH = {"PYTHONSAFEPATH": "1"}
# What makes each library keep to the disk, or keep its counts to itself. Set over what was there.
SWITCHES = {
    "HF_HUB_OFFLINE": "1",
    "TRANSFORMERS_OFFLINE": "1",
    "HF_DATASETS_OFFLINE": "1",
    "HF_HUB_DISABLE_TELEMETRY": "1",
    "HF_HUB_DISABLE_IMPLICIT_TOKEN": "1",
    "DISABLE_TELEMETRY": "1",
    "DO_NOT_TRACK": "1",
    "USE_HUB_KERNELS": "0",  # of transformers: they are downloaded code
    "RAY_USAGE_STATS_ENABLED": "0",
    "AWS_EC2_METADATA_DISABLED": "true",  # botocore comes with ai2thor
    **SAFE_PATH,
}
# What is better so, but a user may want otherwise.
DEFAULTS = {"TOKENIZERS_PARALLELISM": "false", "MPLBACKEND": "Agg"}

_LOCAL_NAMES = frozenset({"localhost", "localhost.localdomain", "ip6-localhost", "ip6-loopback"})
_LOCAL_FAMILIES = frozenset(
    getattr(socket, name) for name in ("AF_UNIX", "AF_NETLINK", "AF_ALG") if hasattr(socket, name)
)
_LOOK_UP = "a look-up of"
_ASKED = {
    "socket.connect": "a connection to",
    "socket.sendto": "a datagram to",
    "socket.sendmsg": "a datagram to",
    "socket.bind": "a port open to other machines at",
    "socket.getaddrinfo": _LOOK_UP,
    "socket.gethostbyname": _LOOK_UP,
    "socket.gethostbyaddr": _LOOK_UP,
    "socket.getnameinfo": _LOOK_UP,
}


class NetworkRefused(KarmaError):
    """Something in this process asked for the network.

    Args:
        what: what it asked for, e.g. "a look-up of 'example.com'".
        caller: file, line and function of the innermost frame that is no part of a library.
        through: the packages between that frame and the socket, the caller's side first.
    """

    def __init__(self, what: str, caller: str, through: tuple[str, ...] = ()) -> None:
        way = f", through {', '.join(through)}" if through else ""
        super().__init__(
            f"the network is off limits: {what} was refused\n  Asked for by: {caller}{way}"
            "\n  To fix: take that call out; only a hosted model may be reached, by "
            "`karma --allow-network ...`"
        )
        self.what, self.caller, self.through = what, caller, through


@dataclass(slots=True)
class _Guard:
    """What the hook goes by; one per process, since a hook is for good."""

    hooked: bool = False
    leave: bool = False
    hosts: set[str] = field(default_factory=set)  # declared by the hosted adapter
    addresses: set[str] = field(default_factory=set)  # that those names turned out to have
    refused: list[NetworkRefused] = field(default_factory=list)


_guard = _Guard()


def go_offline(*, allow_network: bool = False) -> None:
    """Set the libraries' switches and arm the guard; may be called again, in any thread.

    With `allow_network` the hosted adapter's `allow_host` has leave; KarmaError where
    $KARMA_OFFLINE forbids it.
    """
    if allow_network and os.environ.get(OFFLINE) == "1":
        raise KarmaError(f"{OFFLINE}=1 forbids --allow-network\n  To fix: unset {OFFLINE}")
    os.environ.update(SWITCHES)
    for name, value in DEFAULTS.items():
        os.environ.setdefault(name, value)
    if not allow_network:
        os.environ[OFFLINE] = "1"
    _guard.leave = allow_network
    _guard.hosts.clear()
    _guard.addresses.clear()
    _guard.refused.clear()
    if allow_network and socket.getaddrinfo is not _remembering:
        socket.getaddrinfo = _remembering
    if not _guard.hooked:
        _guard.hooked = True
        atexit.register(_end)  # the first that is registered is the last that is called
        sys.addaudithook(_hook)


def is_armed() -> bool:
    """Return whether this process has the guard."""
    return _guard.hooked


def network_allowed() -> bool:
    """Return whether this process was started with --allow-network."""
    return _guard.leave


def allow_host(host: str, what: str = HOSTED) -> None:
    """Let connections to one host pass; adapters of hosted models and remote devices call this.

    It is a name or address, without scheme and port; this machine needs no leave. `what` is there,
    for the message. KarmaError where this process was not started with --allow-network.
    """
    if is_local(host):
        return
    if not _guard.leave:
        instead = ", or replay a cassette" if what == HOSTED else ""
        raise KarmaError(
            f"{what} at {host!r} is on another machine, and this run is offline\n"
            f"  To fix: `karma --allow-network ...`{instead}"
        )
    _guard.hosts.add(host.lower())


def settle() -> None:
    """Raise the first `NetworkRefused` since the start, also where somebody has swallowed it."""
    if _guard.refused:
        raise _guard.refused[0]


def _end() -> None:
    """Let a process fail in which the network was asked for, also while it was ending."""
    if _guard.refused:
        sys.stderr.write(f"error: {_guard.refused[0]}\n")
        sys.stderr.flush()
        sys.stdout.flush()
        os._exit(1)


def forget() -> tuple[NetworkRefused, ...]:
    """Return the refusals since the start and begin anew; for tests that provoke them."""
    found = tuple(_guard.refused)
    _guard.refused.clear()
    return found


# ----------------------------------------------------------------- the hook


def _hook(event: str, arguments: tuple[Any, ...]) -> None:
    asked = _ASKED.get(event)
    if asked is None:
        return
    if asked == _LOOK_UP:
        host = _text(arguments[0][0] if isinstance(arguments[0], tuple) else arguments[0])
        wanted, allowed = repr(host), _may_ask(host)
    elif arguments[1] is not None:
        wanted, allowed = repr(arguments[1]), _may_reach(event, arguments[0], arguments[1])
    else:  # sendmsg where it is connected
        return
    if allowed:
        return
    error = NetworkRefused(f"{asked} {wanted}", *_asker(sys._getframe(1)))
    if not _guard.refused:  # the first tells; repeated attempts do not fill the memory
        _guard.refused.append(error)
    raise error


def _text(host: Any) -> str:
    return bytes.decode(host, errors="replace") if isinstance(host, bytes) else str(host or "")


def _may_ask(host: str) -> bool:
    """Return whether a name may be looked up; none and "any address" ask nobody."""
    return host in ("", "0.0.0.0", "::") or is_local(host) or _declared(host)


def _may_reach(event: str, one: Any, address: Any) -> bool:
    if getattr(one, "family", None) in _LOCAL_FAMILIES:
        return True
    if not isinstance(address, tuple) or not address:
        return False
    host = _text(address[0])
    if event == "socket.bind":
        return is_local(host)
    return _may_ask(host)  # a connection to "any address" ends on this machine


def _declared(host: str) -> bool:
    return _guard.leave and (host.lower() in _guard.hosts or host in _guard.addresses)


def is_local(host: str) -> bool:
    """Return whether a host is this machine.

    >>> [is_local(h) for h in ("127.0.0.1", "::1", "localhost", "127.0.0.1.example.com")]
    [True, True, True, False]
    """
    name = host.lower().rstrip(".").strip("[]")
    if name in _LOCAL_NAMES:
        return True
    try:
        address = ipaddress.ip_address(name.split("%")[0])
    except ValueError:
        return False
    mapped = getattr(address, "ipv4_mapped", None)
    return (mapped or address).is_loopback


_getaddrinfo = socket.getaddrinfo


def _remembering(host: Any, *arguments: Any, **options: Any) -> Any:
    """Look up as `socket.getaddrinfo` does; a declared name's addresses may then be reached."""
    found = _getaddrinfo(host, *arguments, **options)
    if _text(host).lower() in _guard.hosts:
        _guard.addresses.update(str(row[4][0]) for row in found)
    return found


# ----------------------------------------------------------------- who asked

_STDLIB = str(Path(sysconfig.get_path("stdlib")).resolve())


def _asker(frame: FrameType | None) -> tuple[str, tuple[str, ...]]:
    """Return the innermost frame outside libraries, and the packages between it and the socket."""
    through: dict[str, None] = {}
    waiting = threading.main_thread().ident or 0  # for a library's own thread, e.g. asyncio's
    for start in (frame, sys._current_frames().get(waiting)):
        frame = start
        while frame is not None:
            name = frame.f_code.co_filename
            library = str(frame.f_globals.get("__name__", "")).partition(".")[0]
            if library != "karma" and {"site-packages", "dist-packages"} & set(Path(name).parts):
                through[library] = None
            elif name != __file__ and not _is_standard(name):
                return f"{name}:{frame.f_lineno} in {frame.f_code.co_name}", tuple(through)[::-1]
            frame = frame.f_back
    return "unknown code", tuple(through)[::-1]


def _is_standard(name: str) -> bool:
    return name.startswith(("<frozen", _STDLIB)) or os.path.realpath(name).startswith(_STDLIB)
