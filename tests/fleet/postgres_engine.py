"""A PostgreSQL of a test's own, which listens on a socket in its folder alone."""

import pathlib
import signal
import subprocess

SCRIPT = pathlib.Path(__file__).resolve().parent.parent / "support" / "postgres.sh"


def is_missing():
    return subprocess.run([str(SCRIPT), "--check"], check=False, capture_output=True).returncode != 0


class Postgres:
    def __init__(self, folder):
        self.folder = pathlib.Path(folder)
        self.folder.mkdir()
        self.address = f"postgres:///postgres?user=postgres&host={self.folder}"
        self.start()

    def start(self):
        """Does not wait until it answers."""
        self.process = subprocess.Popen([str(SCRIPT), str(self.folder)], stdout=subprocess.DEVNULL,
                                        stderr=subprocess.DEVNULL)

    def kill(self):
        """As in a crash."""
        self.process.send_signal(signal.SIGQUIT)
        self.process.wait()
