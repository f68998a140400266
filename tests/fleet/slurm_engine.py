"""A Slurm of a test's own on this machine: a controller and two nodes that run jobs as this user.

Needs slurmctld, slurmd, slurm-client and munge; no service of them needs to run. Everything listens on ports of its own,
lies in one folder, and is gone at the end.
"""

import ctypes
import os
import pathlib
import pwd
import shutil
import signal
import socket
import subprocess
import time

NODES = ("n1", "n2")
PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch", "squeue", "scontrol", "scancel", "flock")
# Seconds after which the controller gives up a node; Slurm asks each after a third of them.
NODE_TIMEOUT = 12


def missing():
    """Programs that are not installed."""
    path = os.environ.get("PATH", "") + ":/usr/sbin:/sbin"
    return [program for program in PROGRAMS if shutil.which(program, path=path) is None]


def free_ports(count):
    sockets = [socket.socket() for _ in range(count)]
    try:
        for each in sockets:
            each.bind(("127.0.0.1", 0))
        return [each.getsockname()[1] for each in sockets]
    finally:
        for each in sockets:
            each.close()


def wait_until(holds, seconds, what):
    """@param what  is said when the time is up; a function is called then."""
    end = time.monotonic() + seconds
    while not (found := holds()):
        if time.monotonic() > end:
            raise RuntimeError(f"after {seconds} s: {what() if callable(what) else what}")
        time.sleep(0.1)
    return found


class Slurm:
    def __init__(self, folder, cpus=2):
        """@param folder  of its own; jobs of other users must be able to reach it. @param cpus  that a node claims."""
        self.folder = pathlib.Path(folder).resolve()
        self.cpus = cpus
        self.processes = {}
        self.environment = os.environ | {"SLURM_CONF": str(self.folder / "slurm.conf"),
                                         "PATH": os.environ.get("PATH", "") + ":/usr/sbin:/sbin"}

    def start(self):
        self.folder.mkdir(parents=True, exist_ok=True)
        self.start_munge()
        self.configure()
        self.start_controller()
        for node in NODES:
            self.start_node(node)
        wait_until(lambda: self.ask("sinfo", "-h", "-N", "-o", "%T").split() == ["idle"] * len(NODES), 30,
                   "the nodes of Slurm are not up")
        return self

    def start_munge(self):
        munge = self.folder / "munge"
        munge.mkdir(mode=0o755)
        (munge / "key").write_bytes(os.urandom(1024))
        (munge / "key").chmod(0o400)
        # It refuses to be root.
        user = pwd.getpwnam("munge") if os.geteuid() == 0 else pwd.getpwuid(os.getuid())
        if os.geteuid() == 0:
            for path in (munge, munge / "key"):
                os.chown(path, user.pw_uid, user.pw_gid)
        self.launch("munged", ["munged", "-F", f"--key-file={munge}/key", f"--socket={munge}/socket",
                               f"--log-file={munge}/log", f"--pid-file={munge}/pid", f"--seed-file={munge}/seed"], user)
        wait_until((munge / "socket").exists, 10, "munged does not answer")

    def configure(self):
        host, user = socket.gethostname().split(".")[0], pwd.getpwuid(os.getuid()).pw_name
        ports = free_ports(1 + len(NODES))
        for name in ("state", "log"):
            (self.folder / name).mkdir()
        lines = [f"ClusterName=test{os.getpid()}", f"SlurmctldHost={host}(127.0.0.1)", f"SlurmctldPort={ports[0]}",
                 f"SlurmUser={user}", f"SlurmdUser={user}", "AuthType=auth/munge",
                 f"AuthInfo=socket={self.folder}/munge/socket", f"StateSaveLocation={self.folder}/state",
                 f"SlurmdSpoolDir={self.folder}/spool-%n", f"SlurmctldPidFile={self.folder}/controller.pid",
                 f"SlurmdPidFile={self.folder}/%n.pid", f"SlurmdLogFile={self.folder}/log/%n.log", "ProctrackType=proctrack/linuxproc", "TaskPlugin=task/none",
                 "MpiDefault=none", "SwitchType=switch/none", "SelectType=select/cons_tres",
                 "SelectTypeParameters=CR_Core", "ReturnToService=2", f"SlurmdTimeout={NODE_TIMEOUT}", "KillWait=2",
                 "JobAcctGatherType=jobacct_gather/none", "AccountingStorageType=accounting_storage/none",
                 "JobRequeue=1", "SlurmdParameters=config_overrides",
                 # Steps follow each other sooner.
                 "SchedulerParameters=batch_sched_delay=0,sched_interval=1,sched_min_interval=0,bf_interval=1"]
        lines += [f"NodeName={node} NodeHostname={host} NodeAddr=127.0.0.1 Port={port} CPUs={self.cpus} RealMemory=8000"
                  for node, port in zip(NODES, ports[1:])]
        lines.append(f"PartitionName=p Nodes={','.join(NODES)} Default=YES MaxTime=60 State=UP")
        (self.folder / "slurm.conf").write_text("\n".join(lines) + "\n")

    def launch(self, name, command, user=None):
        def become():
            if user is not None and os.geteuid() == 0:
                os.setgroups([])
                os.setgid(user.pw_gid)
                os.setuid(user.pw_uid)
            # After the change of user, which would undo it: ends with this process.
            ctypes.CDLL(None).prctl(1, signal.SIGKILL)

        with open(self.folder / f"{name}.log", "ab") as log:
            self.processes[name] = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=log, stderr=log,
                                                    env=self.environment, preexec_fn=become)

    def start_controller(self):
        """With the jobs that it knew."""
        self.launch("slurmctld", ["slurmctld", "-D"])
        wait_until(lambda: "is UP" in self.ask("scontrol", "ping"), 20, "slurmctld does not answer")

    def start_node(self, node):
        self.launch(node, ["slurmd", "-D", "-N", node])

    def kill(self, name):
        """@param name  `slurmctld` or a node, whose jobs' programs go on."""
        self.processes[name].kill()
        self.processes[name].wait()

    def step_daemons(self, node):
        """Numbers of the processes by which a node looks after its jobs; their jobs' programs are others."""
        log, numbers = f"{self.folder}/log/{node}.log", []
        for folder in pathlib.Path("/proc").glob("[0-9]*"):
            try:
                # Their words name no node.
                if (folder / "cmdline").read_bytes().startswith(b"slurmstepd: ["):
                    if log in [os.readlink(file) for file in (folder / "fd").iterdir()]:
                        numbers.append(int(folder.name))
            except OSError:
                continue
        return numbers

    def ask(self, *command):
        return subprocess.run(command, env=self.environment, capture_output=True, text=True, timeout=60,
                              check=False).stdout

    def stop(self):
        if "slurmctld" in self.processes and self.processes["slurmctld"].poll() is None:
            self.ask("scancel", "--full", f"--user={pwd.getpwuid(os.getuid()).pw_name}")
            end = time.monotonic() + 15
            while self.ask("squeue", "-h").strip() and time.monotonic() < end:
                time.sleep(0.2)
        for process in reversed(list(self.processes.values())):
            process.kill()
            process.wait()
        for node in NODES:
            for number in self.step_daemons(node):
                os.kill(number, signal.SIGKILL)

    def __enter__(self):
        try:
            return self.start()
        except BaseException:
            self.stop()
            raise

    def __exit__(self, *_):
        self.stop()
