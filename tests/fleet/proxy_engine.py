"""HAProxy of a test's own, with a configuration as operators print it."""

import pathlib
import shutil
import signal
import socket
import ssl
import subprocess
import sys
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
GENERATOR = ROOT / "server/deploy/proxy/haproxy_config.py"


#: Where `./dev test` unpacks it.
UNPACKED = ROOT / "build/deploy_tools/usr"


def program():
    """@return words that start it; none when it is not there."""
    installed = shutil.which("haproxy")
    if installed:
        return [installed]
    libraries = ":".join(map(str, UNPACKED.glob("lib/*-linux-gnu")))
    unpacked = UNPACKED / "sbin/haproxy"
    return ["env", f"LD_LIBRARY_PATH={libraries}", str(unpacked)] if unpacked.exists() else []


def missing():
    """Why it cannot run here; empty when it can."""
    return "" if program() else "haproxy is not there (`./dev test` unpacks it)"


class Proxy:
    def __init__(self, folder, servers, host="127.0.0.1", port=8443, prefix=()):
        """@param servers  (host, port, management port) by name."""
        self.folder, self.host, self.port = pathlib.Path(folder), host, port
        self.folder.mkdir()
        certificate = self.folder / "both.pem"
        subprocess.run(["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-days",
                        "1", "-subj", "/CN=stillmap", "-addext", f"subjectAltName=IP:{host}", "-keyout",
                        str(self.folder / "key.pem"), "-out", str(self.folder / "crt.pem")], check=True, capture_output=True)
        certificate.write_text((self.folder / "crt.pem").read_text() + (self.folder / "key.pem").read_text())
        self.tls = ssl.create_default_context(cafile=str(self.folder / "crt.pem"))
        printed = subprocess.run(
            [sys.executable, "-B", str(GENERATOR), "--shared-state", "--bind", f"{host}:{port}", "--certificate",
             str(certificate), "--socket", str(self.folder / "admin.sock"), "--address-connections", "1000", "--user", "",
             *[f"{name}={':'.join(map(str, place))}" for name, place in servers.items()]],
            check=True, capture_output=True, text=True).stdout
        self.config = self.folder / "haproxy.cfg"
        self.config.write_text(printed)
        self.process = subprocess.Popen([*prefix, *program(), "-W", "-S", str(self.folder / "master.sock"), "-f",
                                         str(self.config)], stdout=open(self.folder / "log", "a"), stderr=subprocess.STDOUT)
        self.wait()

    def wait(self, seconds=30):
        end = time.monotonic() + seconds
        while True:
            try:
                socket.create_connection((self.host, self.port), 1).close()
                return
            except OSError:
                assert self.process.poll() is None and time.monotonic() < end, (self.folder / "log").read_text()[-2000:]
                time.sleep(0.05)

    def reload(self):
        self.process.send_signal(signal.SIGUSR2)

    def stop(self):
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
            try:
                self.process.wait(10)
            except subprocess.TimeoutExpired:
                self.process.kill()
