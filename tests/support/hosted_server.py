"""Servers on this machine that speak OpenAI's wire format: llama.cpp's own, and a naughty one.

llama-cpp-python's server runs the nano planner three times over: as it is ("nano"), with a chat
template that adds nothing ("nano-chat"), and as a text embedder by the mean over tokens
("nano-rows"); and once without that pooling ("nano-tokens").
"""

import fcntl
import hashlib
import json
import os
import socket
import struct
import subprocess
import sys
import threading
import time
import traceback
import urllib.error
import urllib.request
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import gguf
import msgspec
import pytest
from gguf.scripts.gguf_new_metadata import MetadataDetails, copy_with_new_metadata

from karma.errors import ModelError
from karma.models.endpoint import Endpoint
from karma.types.planning import Prompt
from support.paths import ROOT

KEY = "sk-planted-4f1c9be2d7"
PROMPT = Prompt(
    stable="#areas\nnode_1 CounterTop Fridge\nnode_2 DiningTable\n",
    changing="#task put the apple in the fridge\n#memory\nApple @CounterTop *\n#program\n",
)
PRICES = {"input": 2.0, "output": 8.0}
REMOTE = "https://models.example.com/v1"
NANO = ROOT / "models" / "nano" / "planner.gguf"
PLAIN = "{% for m in messages %}{{ m.content }}{% endfor %}"
_STARTS_S = 180
_SIOCSIFFLAGS = 0x8914
_UP_AND_RUNNING = 0x1 | 0x40


def with_metadata(source, path, **fields):
    """Copy a GGUF with more metadata."""
    reader = gguf.GGUFReader(source)
    writer = gguf.GGUFWriter(path, "llama")
    new = {
        name.replace("__", "."): MetadataDetails(
            gguf.GGUFValueType.STRING if isinstance(value, str) else gguf.GGUFValueType.UINT32,
            value,
        )
        for name, value in fields.items()
    }
    copy_with_new_metadata(reader, writer, new, [])
    return path


def need_loopback():
    """Skip without loopback; in a namespace of our own (`unshare -rn`) it is switched on first."""
    if _loopback_works():
        return
    if Path("/proc/self/uid_map").read_text().split() == ["0", "0", "4294967295"]:
        pytest.skip("needs the loopback interface, and it is down")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        try:
            fcntl.ioctl(one, _SIOCSIFFLAGS, struct.pack("16sH22x", b"lo", _UP_AND_RUNNING))
        except OSError as error:
            pytest.skip(f"needs the loopback interface, and it cannot be switched on: {error}")


def _loopback_works():
    with socket.socket() as server, socket.socket() as client:
        try:
            server.bind(("127.0.0.1", 0))
            server.listen()
            client.connect(server.getsockname())
        except OSError:
            return False
        return True


def free_port():
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


@contextmanager
def llama_server(folder, *, key):
    """Run llama-cpp-python's server with the nano planner; yields its base URL."""
    template = with_metadata(NANO, folder / "chat.gguf", tokenizer__chat_template=PLAIN)
    rows = with_metadata(NANO, folder / "rows.gguf", llama__pooling_type=1)
    common = {"n_ctx": 2048, "n_threads": 1, "n_threads_batch": 1, "verbose": False}
    models = [
        {"model": str(NANO), "model_alias": "nano", **common},
        {"model": str(template), "model_alias": "nano-chat", **common},
        {"model": str(rows), "model_alias": "nano-rows", "embedding": True, **common},
        {"model": str(NANO), "model_alias": "nano-tokens", "embedding": True, **common},
    ]
    need_loopback()
    port = free_port()
    settings = {"host": "127.0.0.1", "port": port, "api_key": key, "models": models}
    config = folder / "server.json"
    config.write_text(json.dumps(settings))
    environment = {k: v for k, v in os.environ.items() if not k.startswith("OPENAI_")}
    with (folder / "server.log").open("wb") as log:
        process = subprocess.Popen(
            [sys.executable, "-m", "llama_cpp.server", "--config_file", str(config)],
            stdout=log, stderr=log, env=environment,
        )  # fmt: skip
        try:
            _wait(process, port, folder / "server.log")
            yield f"http://127.0.0.1:{port}/v1"
        finally:
            process.terminate()
            process.wait(timeout=20)


def _wait(process, port, log, page="/v1/models"):
    until = time.monotonic() + _STARTS_S
    while time.monotonic() < until and process.poll() is None:
        try:
            urllib.request.urlopen(f"http://127.0.0.1:{port}{page}", timeout=5).close()
        except urllib.error.HTTPError as error:
            if error.code != 503:  # it answers, and wants the key
                return
            time.sleep(0.05)  # still loading
        except OSError:
            time.sleep(0.05)
        else:
            return
    raise RuntimeError(f"the server does not answer:\n{log.read_text(errors='replace')}")


@contextmanager
def wire_server(answer, host="127.0.0.1", port=0, pages=None, forbidden=None):
    """Serve `answer(path, body, headers) -> (status, headers, bytes)`; yields (URL, requests).

    `pages`: path -> JSON value, for GET; others are not there, or `forbidden`: path -> status.
    """
    need_loopback()
    seen = []

    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"
        disable_nagle_algorithm = True  # or each answer waits 40 ms for the client's receipt

        def do_POST(self):
            body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
            given = {name.lower(): value for name, value in self.headers.items()}
            seen.append((self.path, body, given))
            status, headers, data = answer(self.path, body, given)
            if status is None:  # hang up
                self.close_connection = True
                return
            self.send_response(status)
            for name, value in {"Content-Type": "application/json", **headers}.items():
                self.send_header(name, value)
            self.send_header("Content-Length", str(len(data)))
            self.end_headers()
            self.wfile.write(data)

        def do_GET(self):
            found = (pages or {}).get(self.path)
            data = json.dumps(found).encode()
            missing = (forbidden or {}).get(self.path, 404)
            self.send_response(missing if found is None else 200)
            self.send_header("Content-Type", "application/json")
            self.send_header("Content-Length", str(len(data)))
            self.end_headers()
            self.wfile.write(data)

        def log_message(self, *arguments):
            pass

    server = ThreadingHTTPServer((host, port), Handler)
    threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
    try:
        yield f"http://{host}:{server.server_port}/v1", seen
    finally:
        server.shutdown()
        server.server_close()


def chat(text, **more):
    """The bytes of a chat answer."""
    choice = {
        "index": 0,
        "finish_reason": "stop",
        "message": {"role": "assistant", "content": text},
    }
    answer = {"id": "x-1", "created": 1, "model": "wire-1", "choices": [choice], **more}
    return 200, {}, json.dumps(answer).encode()


def household(path, body, headers):
    """Answer as a planner and embedder of no great mind: what is said depends on the words only."""
    if path.endswith("/embeddings"):
        row = [byte / 255 + 0.1 for byte in hashlib.sha256(body["input"].encode()).digest()]
        usage = {"prompt_tokens": len(body["input"])}
        return 200, {}, json.dumps({"data": [{"embedding": row}], "usage": usage}).encode()
    words = json.dumps(body["messages"])
    seen = hashlib.sha256(words.encode()).digest()[0]
    programs = ("PickupObject(robot, 'SoapBar')", "ToggleOn(robot, 'Faucet')", "a good idea")
    usage = {"prompt_tokens": len(words), "completion_tokens": 9}
    return chat(programs[seen % len(programs)], usage=usage)


def plant_key(monkeypatch):
    """Put the key into the environment, and no other setting of the client."""
    for name in list(os.environ):
        if name.startswith("OPENAI_"):
            monkeypatch.delenv(name)
    monkeypatch.setenv("OPENAI_API_KEY", KEY)


def endpoint(url, model="nano-chat", **more):
    fields = {"base_url": url, "model": model, "retries": 0, "dialect": "plain", **more}
    return msgspec.convert(fields, Endpoint)


def whole_story(error):
    """All that a traceback with local variables and all causes would show."""
    story = traceback.TracebackException.from_exception(error, capture_locals=True)
    return "".join(story.format()) + repr(error) + repr(error.args)


def answer_or_story(model):
    try:
        return repr(model.complete(PROMPT))
    except ModelError as error:
        return whole_story(error)


def echo(status, data):
    """A server that says the key back, in its body and in a header."""
    return lambda path, body, headers: (
        status,
        {"X-Echo": headers["authorization"]},
        data.replace(b"KEY", headers["authorization"].removeprefix("Bearer ").encode()),
    )


def real_server_path():
    """Return llama.cpp's own server; skip where `make server` has not been said."""
    built = subprocess.run(
        ["bash", "scripts/build_llama_server.sh", "--where"],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    if built.returncode != 0:
        pytest.skip("needs llama.cpp's own server: make server")
    return built.stdout.strip()


@contextmanager
def real_server(model, folder, *, slots=1, n_ctx=2048, more=()):
    """Run llama.cpp's own server on a model called "tiny"; yields its base URL."""
    program = real_server_path()
    need_loopback()
    port = free_port()
    command = [
        program, "--model", str(model), "--alias", "tiny", "--host", "127.0.0.1",
        "--port", str(port), "--ctx-size", str(n_ctx * slots), "--parallel", str(slots),
        "--threads", "1", "--threads-http", "2", "--flash-attn", "off", "--offline", "--jinja",
        "--cache-ram", "0", *map(str, more),
    ]  # fmt: skip
    with (folder / "real-server.log").open("wb") as log:
        process = subprocess.Popen(command, stdout=log, stderr=log)
        try:
            _wait(process, port, folder / "real-server.log", page="/health")
            yield f"http://127.0.0.1:{port}/v1"
        finally:
            process.kill()
            process.wait(timeout=20)
