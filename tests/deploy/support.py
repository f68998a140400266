"""What the tests of server/deploy/ share: tools that may be missing, folders, a server of our own."""

import http.client
import json
import os
import pathlib
import shutil
import socket
import subprocess
import sys
import tempfile
import time
import unittest

DEPLOY = pathlib.Path(__file__).resolve().parents[2] / "server" / "deploy"
HAPROXY_CONFIG = DEPLOY / "proxy" / "haproxy_config.py"
HERE = pathlib.Path(__file__).resolve().parent


def skip_program(reason):
    """Ends the test program as skipped, in words."""
    print(f"skipped: {reason}", file=sys.stderr)
    sys.exit(77)


def tool(name, tools=None):
    """Path of an installed program, or of one unpacked by `./dev test` into `tools`."""
    for folder in ("usr/sbin", "usr/bin"):
        path = pathlib.Path(tools or "/", folder, name)
        if path.exists():
            return str(path.resolve())
    return shutil.which(name) or skip_program(f"no {name} in {tools or 'PATH'}: ./dev test gets it")


def tool_environment(tools):
    libraries = list(pathlib.Path(tools, "usr/lib").glob("*-linux-gnu"))
    return {**os.environ, "LD_LIBRARY_PATH": ":".join(map(str, libraries))}


def make_package(build, folder):
    """The Debian package of what was built in `build`."""
    folder.mkdir(exist_ok=True)
    made = subprocess.run(["cpack", "-G", "DEB", "--config", build / "CPackConfig.cmake", "-B", folder], cwd=folder,
                          capture_output=True, text=True, timeout=200)
    assert made.returncode == 0, made.stdout + made.stderr
    (package,) = folder.glob("*.deb")
    return package


def wait(what, timeout_s=20):
    end = time.monotonic() + timeout_s
    while time.monotonic() < end:
        found = what()
        if found:
            return found
        time.sleep(0.05)
    raise AssertionError(f"did not come in {timeout_s} s")


def get(port, path, host="127.0.0.1"):
    """Status and text; 0 where nobody answers."""
    connection = http.client.HTTPConnection(host, port, timeout=10)
    try:
        connection.request("GET", path)
        answer = connection.getresponse()
        return answer.status, answer.read().decode(errors="replace")
    except OSError:
        return 0, ""
    finally:
        connection.close()


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def print_haproxy_config(*arguments):
    return subprocess.run([sys.executable, "-B", HAPROXY_CONFIG, *map(str, arguments)], capture_output=True, text=True,
                          check=True).stdout


def haproxy_config(folder, port, servers, *arguments):
    """What is printed for a proxy of a test's own on `port`: certificate and sockets are in `folder`."""
    return print_haproxy_config("--user", "", "--bind", f"127.0.0.1:{port}", "--certificate", folder / "both.pem",
                                "--socket", folder / "admin.sock", "--metrics", f"127.0.0.1:{free_port()}",
                                "--local-peer", f"this=127.0.0.1:{free_port()}", *arguments, *servers)


class FolderTest(unittest.TestCase):
    def setUp(self):
        temporary = tempfile.TemporaryDirectory()
        self.addCleanup(temporary.cleanup)
        self.folder = pathlib.Path(temporary.name)

    def start(self, command, **options):
        program = subprocess.Popen(list(map(str, command)), **options)
        self.addCleanup(self.end, program)
        return program

    @staticmethod
    def end(program):
        if program.poll() is None:
            program.terminate()
            try:
                program.wait(10)
            except subprocess.TimeoutExpired:
                program.kill()
        program.communicate()

    def start_server(self, program, store, *arguments):
        """Its port, once it listens, and its process."""
        server = self.start([program, "serve", "--store", store, "--port", "0", *arguments], stdout=subprocess.PIPE,
                            stderr=subprocess.DEVNULL, text=True)
        line = server.stdout.readline()
        self.assertIn("listening on", line)
        return int(line.rsplit(":", 1)[1].rstrip("/\n")), server


def without_comments(path):
    """The value of a JSON file whose comments stand on lines of their own."""
    lines = pathlib.Path(path).read_text().splitlines()
    return json.loads("\n".join(line for line in lines if not line.lstrip().startswith("//")))
