"""Asks `tests.forked_processes` to run Python, and behaves as that process does: same files, output and exit code.

    python -I -S forked_client.py SOCKET -m MODULE ... | -c CODE ... | SCRIPT ...

If this process is killed, so is the one that was asked for.
"""

import json
import os
import socket
import sys

with socket.socket(socket.AF_UNIX) as server:
    server.connect(sys.argv[1])
    socket.send_fds(server, [b"."], [0, 1, 2])
    server.sendall(json.dumps([sys.argv[2:], os.getcwd(), dict(os.environ)]).encode() + b"\n")
    answer = server.makefile().readline()
code = int(answer) if answer else 255
if code < 0:
    os.kill(os.getpid(), -code)
sys.exit(code)
