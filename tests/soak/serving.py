"""A server of a test's own, and the packages that the soak tests publish."""

import base64
import hashlib
import http.client
import io
import json
import os
import pathlib
import signal
import subprocess
import tarfile
import time


class Package:
    """A small map as a tar, its digest, and what a client sends to be sure of it."""

    def __init__(self, folder):
        self.folder = folder
        manifest = (folder / "manifest.json").read_bytes()
        self.digest = hashlib.sha256(manifest).hexdigest()
        self.files = {path: file["sha256"] for path, file in json.loads(manifest)["files"].items()}
        self.tar, self.headers = self._packed([str(file.relative_to(folder)) for file in sorted(folder.rglob("*"))])

    def beside(self, other):
        """The same without what another package has: tar and headers."""
        known = set(other.files.values())
        return self._packed(["manifest.json", *(path for path, sha256 in self.files.items() if sha256 not in known)])

    def _packed(self, paths):
        buffer = io.BytesIO()
        with tarfile.open(fileobj=buffer, mode="w") as tar:
            for path in paths:
                if (self.folder / path).is_file():
                    tar.add(self.folder / path, arcname=path)
        return buffer.getvalue(), {"Content-Type": "application/x-tar", **digest_header(buffer.getvalue())}


def make_packages(maker, folder, count, schema=2):
    """@return the packages, and a scan of their street as the bytes of a request."""
    subprocess.run([maker, folder, str(count), str(schema)], check=True, timeout=120)
    return [Package(folder / str(i + 1)) for i in range(count)], (folder / "scan.bin").read_bytes()


LOCALIZE = "prior_t=60,0.3,1.8&prior_q=0,0,0,1"


def ask(host, port, method, path, body=None, headers=None, timeout=20, tls=None):
    """@return the response, with `body` and `json`. Raises OSError when none came."""
    if tls is None:
        connection = http.client.HTTPConnection(host, port, timeout=timeout)
    else:
        connection = http.client.HTTPSConnection(host, port, timeout=timeout, context=tls)
    try:
        connection.request(method, path, body=body, headers=headers or {})
        response = connection.getresponse()
        response.body = response.read()
    except http.client.HTTPException as error:
        raise ConnectionError(repr(error)) from error
    finally:
        connection.close()
    response.json = json.loads(response.body) if "json" in response.headers.get("Content-Type", "") else None
    return response


class Server:
    """`stillmap serve` in a process group of its own, so that what it starts can be killed with it."""

    def __init__(self, program, store, log, prefix=(), environment=None, options=(), port=0,
                 host="127.0.0.1"):
        self.started = time.monotonic()
        self.log = open(log, "a")
        self.process = subprocess.Popen(
            [*prefix, program, "serve", "--store", str(store), "--port", str(port), *options], stdout=subprocess.PIPE,
            stderr=self.log, text=True, start_new_session=True, env={**os.environ, **(environment or {})})
        self.host, self.port = host, 0

    def listen(self):
        """@return whether it listens; it has ended otherwise."""
        line = self.process.stdout.readline()
        if line.startswith("listening on "):
            self.port = int(line.rstrip("/\n").rsplit(":", 1)[1])
        return self.port > 0

    def wait_ready(self, most_s):
        """@return seconds from the start to the first 200 of readyz. Raises TimeoutError."""
        while time.monotonic() < self.started + most_s:
            try:
                if self.ask("GET", "/readyz").status == 200:
                    return time.monotonic() - self.started
            except OSError:
                if self.process.poll() is not None:
                    raise TimeoutError(f"ended with {self.process.returncode}") from None
            time.sleep(0.005)
        raise TimeoutError(f"not ready within {most_s} s")

    def ask(self, method, path, body=None, headers=None, timeout=20):
        """As `ask` of this module."""
        return ask(self.host, self.port, method, path, body, headers, timeout)

    def kill(self, group=False):
        """SIGKILL, of what it started too when `group`."""
        if group:
            os.killpg(self.process.pid, signal.SIGKILL)
        else:
            self.process.kill()
        self.end()

    def stop(self):
        """Ends it gracefully. @return its exit code."""
        self.process.terminate()
        return self.end()

    def end(self):
        try:
            self.process.wait(timeout=60)
        finally:
            self.process.stdout.close()
            self.log.close()
        return self.process.returncode


def run(program, *arguments, **options):
    return subprocess.run([program, *map(str, arguments)], capture_output=True, text=True, timeout=120, **options)


def scopes():
    return [argument for scope in ("read", "localize", "write") for argument in ("--scope", scope)]


def make_key(program, store, name="soak"):
    done = run(program, "keys", "create", name, "--store", store, *scopes())
    if done.returncode != 0:
        raise RuntimeError(done.stderr)
    return done.stdout.strip()


def tar_of(folder):
    packed = io.BytesIO()
    with tarfile.open(fileobj=packed, mode="w") as tar:
        tar.add(folder, arcname=".")
    return packed.getvalue()


def digest_header(body):
    return {"Content-Digest": f"sha-256=:{base64.b64encode(hashlib.sha256(body).digest()).decode()}:"}


def upload_drive(server, map_name, packed, headers):
    """@return its id. Raises RuntimeError when it was refused."""
    place = f"/v1/maps/{map_name}/drives"
    made = server.ask("POST", place, '{"name": "tiny"}', {"Content-Type": "application/json", **headers})
    part = server.ask("PUT", f"{place}/{made.json['id']}/parts/1", packed, {**digest_header(packed), **headers})
    done = server.ask("POST", f"{place}/{made.json['id']}/complete", headers=headers)
    if (made.status, part.status, done.status) != (201, 201, 200):
        raise RuntimeError(f"no drive: {made.body} {part.body} {done.body}")
    return made.json["id"]


def small_cloud(number):
    """A map as a PCD, each number another."""
    points = "".join(f"{i % 20} {i // 20} {number % 7}\n" for i in range(400 + number))
    return (f"VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {400 + number}\nHEIGHT 1\n"
            f"POINTS {400 + number}\nDATA ascii\n{points}").encode()


def left_of_jobs(store, ended):
    """What jobs that have ended, and those that nobody knows, leave behind besides logs. @param ended  ids."""
    root = pathlib.Path(store) / "jobs"
    left = []
    for folder in root.iterdir() if root.exists() else []:
        if folder.name == "uploads":
            left += list(folder.iterdir())
        elif folder.name.isdigit() and int(folder.name) in ended:
            left += [each for each in folder.iterdir() if each.name != "log"]
        elif folder.name not in (".lock", ".server"):
            left.append(folder)
    return left


def leftovers(store):
    """Folders of packages that are half there or half gone."""
    return [each.name for each in (pathlib.Path(store) / "packages").iterdir() if each.name.startswith(".")]
