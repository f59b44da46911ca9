"""A user's desk and who asks it, each a process of its own, over real sockets and without a master.

asking.py desk: serves ~command; prints its place, then each command that is decided about.
asking.py console|proxy|once PLACE: the console's link, a proxy of rospy's with a connection that stays open, one as
`rosservice call` makes it. Says "ready", asks what each line names, prints the answer.
"""

from __future__ import annotations

import sys
import threading
import time
from queue import SimpleQueue
from urllib.parse import urlparse

import rospy
from rospy.impl.tcpros import init_tcpros
from rospy.impl.tcpros_base import get_tcpros_server_address

from amaze_autonomy import srv
from amaze_autonomy.console import ros_link
from amaze_autonomy.console.model import Request, RequestKind
from amaze_autonomy.engine.commands import Answer, AnswerKind
from amaze_autonomy.engine.events import UserCommand
from amaze_autonomy.nodes.autonomy import users
from amaze_autonomy.nodes.autonomy.users import UserDesk
from amaze_autonomy.ros.asker import AskedService
from amaze_autonomy.ros.rospy_flaws import mend_rospy
from amaze_autonomy.ros.service_client import ServiceClient

COMMAND = "/autonomy/command"
ENGINE_LIMIT_S, CONSOLE_LIMIT_S = 2.0, 1.0


def serve():
    users._ANSWER_LIMIT_S = users._OLDEST_S = ENGINE_LIMIT_S
    mend_rospy()
    events = SimpleQueue()
    desk = UserDesk((), events.put, time.monotonic_ns)

    def decide():
        while True:
            event = events.get(timeout=600.0)
            if desk.take_up(event):
                print(event.command.value, flush=True)
                desk.answer(Answer(request_id=event.request_id, answer=AnswerKind.DONE, message="done"))

    threading.Thread(target=decide, daemon=True).start()
    init_tcpros()
    service = AskedService(COMMAND, srv.UserCommand, desk._named)
    host, port = get_tcpros_server_address()
    print(f"rosrpc://{host}:{port}", flush=True)
    sys.stdin.read()
    del service


def console(place):
    """Return what asks as a console does, over a connection that is open already."""
    ros_link._ANSWER_S = CONSOLE_LIMIT_S
    where = urlparse(place)
    ServiceClient._look_up = lambda *_: (where.hostname, where.port)
    came = SimpleQueue()
    link = ros_link.RosLink(came.put, None, quiet=False)
    link._services = {"command": ServiceClient(COMMAND, srv.UserCommand, "", "/console")}
    link._services["command"].keep(30.0)

    def ask(word):
        link.send(Request(RequestKind.COMMAND, 1, UserCommand(word)))
        answer = came.get(timeout=60.0)
        return f"{answer.verdict.name}: {answer.message}"

    return ask


def proxy(place, *, persistent):
    """Return what asks as somebody else's program does."""
    rospy.ServiceProxy._get_service_uri = lambda *_: place
    asks = rospy.ServiceProxy(COMMAND, srv.UserCommand, persistent=persistent)
    if persistent:
        asks("nothing")  # connects

    def ask(word):
        try:
            answer = asks(word)
        except rospy.ServiceException as error:
            return f"NO_ANSWER: {error}"
        return f"{AnswerKind(answer.answer).name}: {answer.message}"

    return ask


def main(role, place=""):
    if role == "desk":
        serve()
        return
    import rospy.impl.tcpros_base as base  # noqa: PLC0415 - a proxy asks the master for this, once

    base._use_tcp_keepalive = True
    ask = console(place) if role == "console" else proxy(place, persistent=role == "proxy")
    print("ready", flush=True)
    for line in sys.stdin:
        print(ask(line.strip()), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
