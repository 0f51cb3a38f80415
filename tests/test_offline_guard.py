"""The guard: whoever asks for the network is refused and named, in each way there is to ask.

Covered: Python's own calls, requests, urllib3, httpx, asyncio; what swallows the refusal; loopback
and Unix sockets; leave for declared hosts; the header of a run. Not covered: compiled code
that goes past Python's socket module, which `scripts/airgap.sh` is for.
"""

import json
import os
import socket
import subprocess
import sys
import threading
from contextlib import suppress

import pytest
from support.paths import ROOT

from karma.offline import guard as offline
from karma.offline.guard import NetworkRefused

ELSEWHERE = ("192.0.2.1", 80)  # a block that documentation has to itself

ASKING = {
    "connect": "socket.socket().connect(('192.0.2.1', 80))",
    "create_connection": "socket.create_connection(('example.org', 80))",
    "sendto": "socket.socket(type=socket.SOCK_DGRAM).sendto(b'x', ('192.0.2.1', 53))",
    "sendmsg": "socket.socket(type=socket.SOCK_DGRAM).sendmsg([b'x'], [], 0, ('192.0.2.1', 53))",
    "getaddrinfo": "socket.getaddrinfo('example.org', 443)",
    "gethostbyname": "socket.gethostbyname('example.org')",
    "bind": "socket.socket().bind(('0.0.0.0', 8899))",
    "requests": "__import__('requests').get('http://example.org')",
}

EXPERT = (
    f'name = "x"\ntasks = "{ROOT}/eval/alfred_l/tasks.jsonl"\nonly = ["simple-12"]\n'
    '[[rows]]\nname = "expert"\nmethod = "expert"\n'
)
_OURS = {offline.OFFLINE, *offline.SWITCHES, *offline.DEFAULTS}


def python(program, folder, **environment):
    """Run a program of its own; return (exit code, output, errors)."""
    given = {k: v for k, v in os.environ.items() if k not in _OURS}
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=folder, env={**given, **environment}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    return done.returncode, done.stdout, done.stderr


@pytest.fixture
def refusals():
    """The refusals that a test provokes, which then do not fail it."""
    offline.forget()
    yield offline.forget
    offline.forget()


@pytest.mark.parametrize("way", sorted(ASKING))
def test_asking_for_the_network_is_refused_and_this_line_named(way, refusals):
    try:
        with pytest.raises(NetworkRefused, match="off limits") as caught:
            eval(compile(ASKING[way], __file__, "eval"))
    finally:
        assert len(refusals()) >= 1
    assert caught.value.caller.startswith(f"{__file__}:")
    assert "--allow-network" in str(caught.value)


def test_refusal_names_the_libraries_on_the_way(refusals):
    import requests

    with pytest.raises(NetworkRefused) as caught:
        requests.get("http://example.org/weights.bin", timeout=1)
    assert caught.value.through == ("requests", "urllib3")
    assert "test_refusal_names_the_libraries_on_the_way" in caught.value.caller


def test_swallowed_refusal_still_comes_to_light(refusals):
    with suppress(Exception):  # what a careless library does
        socket.create_connection(ELSEWHERE)
    with pytest.raises(NetworkRefused, match=r"192\.0\.2\.1"):
        offline.settle()


def test_loopback_and_unix_sockets_are_free(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        for host in ("127.0.0.1", "localhost"):
            with socket.create_connection((host, port)) as one:
                assert one.getpeername()[1] == port
        for host in ("", "0.0.0.0"):  # "any address" is this machine's own, for who connects
            with socket.socket() as one:
                one.connect((host, port))
                assert one.getpeername() == ("127.0.0.1", port)
    assert socket.getaddrinfo("::1", 80)
    with socket.socket(socket.AF_UNIX) as server, socket.socket(socket.AF_UNIX) as one:
        server.bind(str(tmp_path / "s"))
        server.listen()
        one.connect(str(tmp_path / "s"))


@pytest.mark.parametrize("host", ["127.0.0.1.example.org", "localhost.example.org", "128.0.0.1"])
def test_what_only_looks_like_loopback_is_refused(host, refusals):
    with pytest.raises(NetworkRefused):
        socket.getaddrinfo(host, 80)


def test_loopback_in_version_six_clothes_is_loopback(refusals):
    with socket.socket(socket.AF_INET6) as one, pytest.raises(NetworkRefused):
        one.connect(("::ffff:192.0.2.1", 80))
    refusals()
    with socket.create_server(("127.0.0.1", 0)) as server, socket.socket(socket.AF_INET6) as one:
        one.connect(("::ffff:127.0.0.1", server.getsockname()[1]))


def test_threads_are_guarded(refusals):
    thread = threading.Thread(target=lambda: socket.socket().connect_ex(ELSEWHERE))
    hook, threading.excepthook = threading.excepthook, lambda _: None
    try:
        thread.start()
        thread.join()
    finally:
        threading.excepthook = hook
    assert [one.what for one in refusals()] == ["a connection to ('192.0.2.1', 80)"]


# ----------------------------------------------------------------- switches and leave


def test_switches_are_set_over_what_was_there(tmp_path):
    program = (
        "import os, karma.offline.guard as o; o.go_offline();"
        "print([k for k, v in o.SWITCHES.items() if os.environ[k] != v], os.environ['MPLBACKEND'])"
    )
    assert python(program, tmp_path, HF_HUB_OFFLINE="0", MPLBACKEND="svg")[1] == "[] svg\n"


def test_leave_reaches_declared_hosts_only(tmp_path):
    program = (
        "import socket, sys\n"
        "from karma.offline.guard import *\n"
        "go_offline(allow_network=True)\n"
        "allow_host('192.0.2.1')\n"
        "one = socket.socket()\n"  # the question alone: no test really calls
        "sys.audit('socket.connect', one, ('192.0.2.1', 9)); print('tried')\n"
        "try: sys.audit('socket.connect', one, ('192.0.2.2', 9))\n"
        "except NetworkRefused: print('refused')\n"
    )
    code, out, _ = python(program, tmp_path)
    assert (code, out) == (1, "tried\nrefused\n")  # a process that was refused has failed


def test_leave_for_a_name_covers_the_addresses_it_has(tmp_path):
    program = (
        "import socket, sys, karma.offline.guard as o\n"
        "o._getaddrinfo = lambda *a, **k: [(2, 1, 6, '', ('192.0.2.7', 80))]  # a name server\n"
        "o.go_offline(allow_network=True)\n"
        "o.allow_host('Models.Example')\n"
        "(row,) = socket.getaddrinfo('models.example', 80)\n"
        "sys.audit('socket.connect', socket.socket(), row[4]); print('tried')\n"
    )
    code, out, err = python(program, tmp_path)
    assert (code, out) == (0, "tried\n"), err


def test_lab_can_forbid_leave(tmp_path):
    command = "from karma.cli import app; app(['--allow-network', 'world', 'list'])"
    assert python(command, tmp_path)[0] == 0
    code, _, err = python(command, tmp_path, **{offline.OFFLINE: "1"})
    assert code == 1
    assert "unset KARMA_OFFLINE" in err


def test_header_of_a_run_says_that_it_had_no_leave(tmp_path):
    (tmp_path / "x.toml").write_text(EXPERT)
    _, _, err = python("from karma.cli import app; app(['eval', 'x.toml'])", tmp_path)
    header = json.loads((tmp_path / "runs/x/header.json").read_text())
    assert header["network"] is False, err  # with leave: tests/plugins/hosted/test_hosted.py


# ----------------------------------------------------------------- planted calls

PLANTED = """
import sys
import karma.world.sim as sim

plain = sim.EmbeddedWorld.reset

def reset(self, *given, **options):
    {call}
    return plain(self, *given, **options)

sim.EmbeddedWorld.reset = reset
from karma.cli import app
app(sys.argv[1:])
"""
CALLS = {
    "open": "__import__('urllib.request').request.urlopen('http://192.0.2.1/')",
    "hidden": "try: __import__('requests').get('http://example.org')\n    except Exception: pass",
}


@pytest.mark.parametrize("kind", sorted(CALLS))
def test_planted_call_fails_the_run_and_is_named(kind, tmp_path):
    """A world that telephones home; also one that hides it."""
    (tmp_path / "x.toml").write_text(EXPERT)
    (tmp_path / "planted.py").write_text(PLANTED.format(call=CALLS[kind]))
    done = subprocess.run(
        [sys.executable, "planted.py", "eval", "x.toml"],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 1
    assert "the network is off limits" in done.stderr
    line = 1 + PLANTED.splitlines().index("    {call}")
    assert f"planted.py:{line} in reset" in done.stderr
    assert not (tmp_path / "runs/x/episodes.jsonl").exists()
