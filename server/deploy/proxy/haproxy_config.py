#!/usr/bin/env python3
"""Prints a configuration of HAProxy 2.6 or later for one or several stillmap servers.

    haproxy_config.py one=10.0.0.11:8080:8081 two=10.0.0.12:8080:8081 > haproxy.cfg
    haproxy_config.py --shared-state a=10.0.1.11:8080:8081 b=10.0.2.11:8080:8081 c=10.0.3.11:8080:8081 > haproxy.cfg

A server is NAME=HOST:PORT[:MANAGEMENT_PORT]. How to use the result: ../README.md and ../../docs/scale.md.
"""

import argparse
import re
import shlex
import sys

# Of the server's `connections` (512): the sum of these must stay below it.
MOST_CONNECTIONS = {"poses": 200, "maps": 80, "sessions": 110, "uploads": 20, "named": 90}

HEAD = """\
# Printed by haproxy_config.py (beside it); change its arguments, not this file. `haproxy -c -f FILE` checks it.
#   {command}
global
{user}  maxconn {most_connections}
  log stdout format raw local0 notice
  ssl-default-bind-options ssl-min-ver TLSv1.2
  # Commands for operators (drain, state, statistics). The listening sockets go to the new process at a reload.
  stats socket {socket} mode 660 level admin expose-fd listeners
  # After a reload the old process ends with its last request, or then: event streams have no end.
  hard-stop-after 1h
  # A request is sent again only if all of it fits: thin scans do (at most some 180 kB), whole ones do not.
  tune.bufsize {buffer_bytes}
  localpeer {local_peer}

# At a reload the old process gives the new one what it knows of sessions; other proxies are told, too.
peers proxies
{peers}

defaults
  mode http
  log global
  # A head must be complete by then, and a scan of a pose as far as the buffer holds it: cuts those who send a byte now
  # and then.
  timeout http-request 10s
  timeout http-keep-alive 5s
  # Silence, not duration: event streams and uploads may last. The server writes into a silent stream every 15 s.
  timeout client 60s
  timeout server 60s
  # Also the pause before a server that refused is tried again, and what a pose loses to one that vanished.
  timeout connect 500ms
  timeout queue 5s
  timeout check 2s
  option dontlognull
  # The server believes it where trusted_proxies names this machine and forwarded is x-forwarded-for.
  option forwardfor
  # Who has left frees an event stream at once.
  option abortonclose
  # The server ends idle connections after 2 s.
  http-reuse never
  # No server is there: clients wait as long and ask again.
  http-error status 503 content-type application/problem+json hdr Retry-After 1 string '{away}'

frontend metrics
  bind {metrics}
  http-request use-service prometheus-exporter if {{ path /metrics }}
  http-request deny

frontend https
  bind {bind} ssl crt {certificate} alpn h2,http/1.1
  maxconn {connections}
  # At a reload a client's idle connection has one more request, instead of ending as this is on its way.
  option idle-close-on-response
  # Connections of one address; a fleet behind one address needs more.
  stick-table type ipv6 size 100k expire 1m store conn_cur,http_req_rate(10s)
  tcp-request connection track-sc0 src
  tcp-request connection reject if {{ sc0_conn_cur gt {address_connections} }}
{address_rate}\
  # max_payload_bytes of the server; packages and drives come by PUT and are bounded there.
  http-request deny deny_status 413 if !{{ method PUT }} {{ req.hdr(content-length) -m int gt 67108864 }}
  # Silent until all is fetched from S3, unpacked, on the disk, indexed.
  acl slow path_reg ^/v1/maps/[^/]+/(rollback|rollout|versions/[^/]+(/activate)?)$
  acl slow path_reg ^/v1/maps/[^/]+/(drives|uploads)/[^/]+/(complete|parts/[^/]+)$
  http-request set-var(txn.is_slow) bool(true) if slow !METH_GET
  # Silent until the package is fetched from S3, and for `content` compared with its checksums.
  http-request set-var(txn.is_slow) bool(true) if {{ path_reg ^/v1/maps/[^/]+/versions/[^/]+ }} METH_GET
  http-response set-header Strict-Transport-Security max-age=63072000
  acl poses path_reg ^/v1/(maps/[^/]+/(versions/[^/]+/)?)?localize(/batch|/next)?$
  acl sessions path_reg ^/v1/sessions(/|$)
  # A host's name that begins with the name of a server finds that server.
{by_name}
  use_backend poses if poses METH_POST
  use_backend sessions if sessions
"""

RATE = """\
  http-request deny deny_status 429 hdr Retry-After 1 if {{ sc0_http_req_rate gt {per_10_s} }}
"""

APART = """\
  # Each server has a state of its own. Since they have the same maps and keys, either can be asked to read of maps. All
  # else lives in one store (jobs and their numbers, uploads, keys, the audit log, changes) and finds the first server.
  # Versions are brought to the others by their own names.
  acl of_maps path_reg ^/v1/(status|maps(/[^/]+(/(ready|rollout|stats|tiles|vehicles|versions)(/.*)?)?)?)$
  acl of_version_1 path_beg /v1/
  use_backend maps if METH_GET of_maps or METH_GET !of_version_1 or { path_reg ^/v1/maps/[^/]+/tiles/diff$ }
  default_backend {first}
"""

SHARED = """\
  # The servers share one state, so any of them can be asked.
  default_backend maps
"""

UPLOADS_RULE = """\
  # But for uploads and drives: they, and what is made of them, lie in the folder of the server that got them.
  use_backend uploads if { path_reg ^/v1/maps/[^/]+/((drives|uploads)(/.*)?|rebuild)$ }
"""

POSES = """
backend poses
  # The poses of one map, or set, and region reach one server, whose memory then holds that part. Without the header the
  # label of the vehicle counts, which moves little between two scans; without that the map. A seal is another one each
  # time, so it is no use.
  http-request set-var(txn.place) url_param(vehicle)
  http-request set-var(txn.place) req.fhdr(Stillmap-Region) if {{ req.fhdr(Stillmap-Region) -m found }}
  http-request set-var(txn.map) url_param(set)
  http-request set-var(txn.map) path,field(4,/) if {{ path_beg /v1/maps/ }}
  http-request set-var-fmt(txn.place) "%[var(txn.map)] %[var(txn.place)]"
  balance hash var(txn.place)
  hash-type consistent
  # Most requests in progress of one server, in percent of the mean: the next server gets the rest.
  hash-balance-factor 150
  # A server gets a scan when all of it is here, so that slow senders hold no place there.
  option http-buffer-request
  # A pose changes nothing, and a sealed scan that comes again is answered with the same bits. So it is asked of another
  # server when the first one is away, died before it answered, or refused (503: it is full, or its map is not loaded).
  # Not after silence: the deadline has passed by then, and it would be asked of a server that is no faster.
  retries 3
  option redispatch 1
  retry-on conn-failure empty-response 503
  # The management port must be reachable from here (management.host); it answers when the main port is full.
  option httpchk
  http-check send meth GET uri /readyz ver HTTP/1.1 hdr Host stillmap
  http-check expect status 200
  # One connection that fails tells sooner than the checks. A server that is only thought to be there keeps its share of
  # the load from the others, and more so while these start slowly.
  default-server inter 2s fall 2 rise 2 fastinter 500ms slowstart 20s maxconn {maxconn}
  default-server observe layer4 error-limit 1 on-error mark-down
"""

MAPS = """
# It, and `sessions`, follow the state of the servers in `poses`.
backend maps
  # The requests for a map reach one server: who has changed it sees the change at once.
  balance hash path,field(4,/)
  hash-type consistent
  # What only reads is asked of another server. A change is sent once: another server gets it only if no connection came
  # about, so that nothing of it was sent.
  retries 2
  option redispatch 1
  retry-on conn-failure empty-response 503
  http-request disable-l7-retry if !METH_GET
  http-request set-timeout server 1h if { var(txn.is_slow) -m found }
"""

SESSIONS = """
backend sessions
  balance roundrobin
  # A session lives in the server that opened it. Without that server another one answers that it does not know it, and
  # the client opens a new one.
  stick-table type string len 64 size 100k expire 10m peers proxies
  stick match path,field(4,/) if { path_beg /v1/sessions/ }
  stick store-response res.hdr(location),field(4,/) if { res.hdr(location) -m beg /v1/sessions/ }
  retries 2
  option redispatch 1
  retry-on conn-failure empty-response 503
  http-request disable-l7-retry if !METH_GET
"""

UPLOADS = """
# Not checked: another server has not got these files. While it starts again, requests wait some 10 s for it.
backend uploads
  balance hash path,field(4,/)
  hash-type consistent
  retries 10
  http-request set-timeout server 1h if { var(txn.is_slow) -m found }
"""

NAMED = """
backend {name}
  http-request set-timeout server 1h if {{ var(txn.is_slow) -m found }}
  server {name} {address} maxconn {maxconn}
"""

AWAY = '{"type":"about:blank","title":"No server answers","status":503}'


class Server:
    def __init__(self, text):
        match = re.fullmatch(r"([A-Za-z][\w-]*)=(\[[0-9A-Fa-f:.]+\]|[^:=\s]+):(\d+)(?::(\d+))?", text)
        if not match:
            raise argparse.ArgumentTypeError(f"found '{text}', expected NAME=HOST:PORT[:MANAGEMENT_PORT]")
        self.name, self.address = match[1], f"{match[2]}:{match[3]}"
        self.check = f"check port {match[4]}" if match[4] else "check"
        if self.name in ("poses", "maps", "sessions", "uploads", "metrics", "https", "proxies"):
            raise argparse.ArgumentTypeError(f"found the name '{self.name}', which a part of the configuration has: "
                                             "choose another one")


def server_lines(servers, options):
    return "".join(f"  server {server.name} {server.address} {options(server)}\n" for server in servers)


def config(arguments, command):
    servers = arguments.servers
    by_name = "\n".join(f"  use_backend {server.name} if {{ req.hdr(host) -i -m beg {server.name}. }}"
                        for server in servers)
    local = arguments.local_peer.split("=", 1)
    peers = "\n".join(f"  peer {name} {address}" for name, address in
                      [local, *(peer.split("=", 1) for peer in arguments.peer)])
    rate = RATE.format(per_10_s=10 * arguments.address_rate) if arguments.address_rate else ""
    tracked = {name: lambda server, most=most: f"track poses/{server.name} maxconn {most}" for name, most in
               MOST_CONNECTIONS.items()}
    user = f"  user {arguments.user}\n  group {arguments.user}\n" if arguments.user else ""
    text = HEAD.format(command=command, user=user, socket=arguments.socket, buffer_bytes=arguments.buffer_bytes,
                       local_peer=local[0], peers=peers, away=AWAY, metrics=arguments.metrics, bind=arguments.bind,
                       certificate=arguments.certificate, address_connections=arguments.address_connections,
                       connections=arguments.connections, most_connections=2 * arguments.connections,
                       address_rate=rate, by_name=by_name)
    # Servers that share a folder share the uploads in it, too.
    has_uploads = arguments.shared_state and not arguments.shared_folder
    if has_uploads:
        text += UPLOADS_RULE
    text += SHARED if arguments.shared_state else APART.replace("{first}", servers[0].name)
    text += POSES.format(maxconn=MOST_CONNECTIONS["poses"]) + server_lines(servers, lambda server: server.check)
    text += MAPS + server_lines(servers, tracked["maps"])
    text += SESSIONS + server_lines(servers, tracked["sessions"])
    if has_uploads:
        text += UPLOADS + server_lines(servers, lambda server: f"maxconn {MOST_CONNECTIONS['uploads']}")
    text += "\n# Not checked: a server whose maps are still loading knows its jobs already."
    return text + "\n".join(NAMED.format(name=server.name, address=server.address,
                                         maxconn=MOST_CONNECTIONS["named"]).rstrip("\n") for server in servers) + "\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("servers", nargs="+", type=Server, metavar="SERVER", help="NAME=HOST:PORT[:MANAGEMENT_PORT]")
    parser.add_argument("--shared-state", action="store_true", help="they share one state (PostgreSQL)")
    parser.add_argument("--shared-folder", action="store_true", help="and one folder, with its uploads and drives")
    parser.add_argument("--certificate", default="/etc/haproxy/stillmap.pem", help="PEM with the key in it")
    parser.add_argument("--bind", default=":443", help="address to listen on")
    parser.add_argument("--connections", type=int, default=1000, metavar="N",
                        help="most of all clients; a vehicle that sends each second holds one")
    parser.add_argument("--address-connections", type=int, default=100, metavar="N", help="most of one client address")
    parser.add_argument("--address-rate", type=int, default=0, metavar="N",
                        help="most requests/s of one client address in 10 s; 0: no bound")
    parser.add_argument("--buffer-bytes", type=int, default=262144, metavar="N",
                        help="largest request that is sent again; a request in progress takes some two of them")
    parser.add_argument("--user", default="haproxy", help="user and group that HAProxy runs as; '': who starts it")
    parser.add_argument("--socket", default="/run/haproxy/admin.sock", help="socket for commands")
    parser.add_argument("--metrics", default="127.0.0.1:8405", metavar="HOST:PORT", help="for Prometheus")
    parser.add_argument("--local-peer", default="this=127.0.0.1:10000", metavar="NAME=HOST:PORT",
                        help="this proxy, for reloads and other proxies")
    parser.add_argument("--peer", action="append", default=[], metavar="NAME=HOST:PORT", help="another proxy")
    arguments = parser.parse_args()
    if arguments.shared_folder and not arguments.shared_state:
        parser.error("found --shared-folder alone, expected --shared-state with it")
    names = [server.name.lower() for server in arguments.servers]
    if len(set(names)) < len(names):
        parser.error(f"found the names {', '.join(names)}, expected a name of its own for each server")
    for peer in [arguments.local_peer, *arguments.peer]:
        if not re.fullmatch(r"[\w-]+=\S+:\d+", peer):
            parser.error(f"found '{peer}', expected NAME=HOST:PORT")
    print(config(arguments, shlex.join(["haproxy_config.py", *sys.argv[1:]])), end="")


if __name__ == "__main__":
    main()
