"""The `rosservice call` lines of docs/integrator.md, as rosservice reads them; each is called by a test."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import Any, List, NamedTuple

import rospy
import rosservice
import yaml
from genpy.message import fill_message_args

OURS = "/autonomy/"
"""What the engine offers; the others are of its peers."""
_PAGE = Path(__file__).resolve().parents[2] / "docs" / "integrator.md"
_LINE = re.compile(r"^rosservice call (.*?)(?: +#.*)?$", re.MULTILINE)


class Call(NamedTuple):
    """One line: the name of the service, and the fields of its request."""

    name: str
    given: List[Any]

    @property
    def word(self) -> str:
        """The last part of the name."""
        return self.name.rsplit("/", 1)[1]

    def ask(self, namespace: str) -> Any:
        """Call it below a namespace; return the answer."""
        service = f"{namespace}{self.name}"
        kind = rosservice.get_service_class_by_name(service)
        request = kind._request_class()
        fill_message_args(request, self.given)
        return rospy.ServiceProxy(service, kind)(request)


def calls(mission: str = "1") -> List[Call]:
    """Return the lines in their order, with a mission in the place of '1'."""
    found = []
    for line in _LINE.findall(_PAGE.read_text(encoding="utf-8")):
        name, *given = shlex.split(line.replace("'1'", f"'{mission}'"))
        found.append(Call(name, [yaml.safe_load(each) for each in given]))
    return found
