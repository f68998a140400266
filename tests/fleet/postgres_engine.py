"""A PostgreSQL of a test's own, which listens on a socket in its folder alone, and a pair of them with addresses."""

import contextlib
import os
import pathlib
import shutil
import signal
import subprocess
import time

SCRIPT = pathlib.Path(__file__).resolve().parent.parent / "support" / "postgres.sh"
PORT = 5432


def is_missing():
    return subprocess.run([str(SCRIPT), "--check"], check=False, capture_output=True).returncode != 0


def signal_all(process, number):
    """SIGSTOP: it hangs, as with its machine. SIGCONT: it goes on."""
    process.send_signal(number)
    children = pathlib.Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text()
    for child in children.split():
        with contextlib.suppress(ProcessLookupError):
            os.kill(int(child), number)


class Postgres:
    def __init__(self, folder, host="", prefix=()):
        """@param host  to listen on, besides the socket. @param prefix  words before its command."""
        self.folder, self.host, self.prefix = pathlib.Path(folder), host, list(prefix)
        self.folder.mkdir(exist_ok=True)
        self.address = f"postgres:///postgres?user=postgres&host={self.folder}"
        self.settings = []
        if host:
            hba = self.folder / "hba.conf"
            hba.write_text("local all all trust\nhost all all all trust\nhost replication all all trust\n")
            self.settings = [f"listen_addresses={host}", f"port={PORT}", f"hba_file={hba}", "wal_keep_size=64MB",
                             # A standby that was lost follows again as soon as it is back.
                             "wal_retrieve_retry_interval=500ms"]
        self.process = None
        self.start()

    def start(self):
        """Does not wait until it answers."""
        self.process = subprocess.Popen([*self.prefix, str(SCRIPT), str(self.folder), *self.settings],
                                        stdout=subprocess.DEVNULL, stderr=open(self.folder / "log", "a"))

    def kill(self):
        """As in a crash."""
        self.process.send_signal(signal.SIGQUIT)
        self.process.wait()

    def freeze(self):
        signal_all(self.process, signal.SIGSTOP)

    def thaw(self):
        signal_all(self.process, signal.SIGCONT)

    def sql(self, text):
        done = subprocess.run(["psql", "-h", str(self.folder), "-U", "postgres", "-XAtqc", text], capture_output=True,
                              text=True, check=False, timeout=60)
        if done.returncode != 0:
            raise RuntimeError(f"{text}: {done.stderr}")
        return done.stdout.strip()

    def wait(self, seconds=60):
        """Until it answers."""
        end = time.monotonic() + seconds
        while True:
            try:
                return self.sql("SELECT 1")
            except RuntimeError:
                if time.monotonic() > end:
                    raise
                time.sleep(0.05)


class Standby(Postgres):
    """Follows another one, and can take its place."""

    def __init__(self, folder, host, prefix, primary):
        folder = pathlib.Path(folder)
        self._copy(folder, prefix, primary)
        super().__init__(folder, host, prefix)

    @staticmethod
    def _copy(folder, prefix, primary):
        folder.mkdir()
        as_user = []
        if os.geteuid() == 0:
            shutil.chown(folder, "nobody")
            as_user = ["setpriv", "--reuid", "nobody", "--regid", "nogroup", "--clear-groups"]
        tool = next(pathlib.Path("/usr/lib/postgresql").glob("*/bin/pg_basebackup"))
        done = subprocess.run([*prefix, *as_user, str(tool), "-h", primary.host, "-p", str(PORT), "-U", "postgres", "-D",
                               str(folder / "data"), "-R", "-X", "stream", "--checkpoint=fast", "--no-sync"], check=False,
                              capture_output=True, text=True, timeout=120)
        if done.returncode != 0:
            raise RuntimeError(done.stderr)


class PostgresPair:
    """A primary and its synchronous standby, each on its own machine."""

    def __init__(self, folder, network, names):
        self.folder, self.network, self.names = pathlib.Path(folder), network, list(names)
        self.folder.mkdir()
        self.folder.chmod(0o755)
        self.address = "postgres://postgres@" + ",".join(f"{network.address(name)}:{PORT}" for name in names) + "/postgres"
        self.count = 0
        self.primary = self._new(self.names[0])
        self.standby = self._new(self.names[1], self.primary)
        self._be_synchronous()

    def _new(self, name, primary=None):
        self.count += 1
        place = (self.folder / str(self.count), self.network.address(name), self.network.prefix(name))
        made = Postgres(*place) if primary is None else Standby(*place, primary)
        made.wait()
        return made

    def _be_synchronous(self):
        end = time.monotonic() + 60
        while self.primary.sql("SELECT count(*) FROM pg_stat_replication WHERE state = 'streaming'") != "1":
            if time.monotonic() > end:
                raise RuntimeError("the standby does not follow")
            time.sleep(0.05)
        self.primary.sql("ALTER SYSTEM SET synchronous_standby_names TO '*'")
        self.primary.sql("SELECT pg_reload_conf()")

    def fail_over(self):
        """The primary is killed for good, and its standby takes its place, alone."""
        self.primary.kill()
        self.standby.sql("ALTER SYSTEM RESET synchronous_standby_names")
        self.standby.sql("SELECT pg_reload_conf()")
        self.standby.sql("SELECT pg_promote()")
        self.names.reverse()
        self.primary, self.standby = self.standby, None

    def add_standby(self):
        """Anew: what the old primary has is never used again."""
        self.standby = self._new(self.names[1], self.primary)
        self._be_synchronous()

    def stop(self):
        for each in (self.standby, self.primary):
            if each is not None and each.process.poll() is None:
                each.thaw()
                each.kill()
