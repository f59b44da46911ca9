"""The simulated PX4 on UDP: one thread, any number of endpoints, each its own MAVLink connection.

``udpin:HOST:PORT`` waits there; everyone who speaks to it becomes a connection of its own. ``udpout:HOST:PORT`` speaks
to that address from the beginning, as PX4 does to computers on board.
"""

from __future__ import annotations

import contextlib
import logging
import select
import socket
import threading
import time
from typing import Any, Callable, Dict, List, NamedTuple, Optional, Protocol, Tuple

from amaze_autonomy.autopilot.errors import EndpointError
from amaze_autonomy.simulation.px4 import Framing, Px4, VehicleAddressError

from ...autopilot.link.ports import Endpoint, EndpointKind, parse_endpoint

__all__ = ["VehicleServer", "VehicleTime"]

_SLICE_S, _LEAST_S = 0.02, 0.004
_PEERS_MAX = 16
_BYTES = 65536
_log = logging.getLogger(__name__)

_Place = Tuple[str, int]


class VehicleTime(Protocol):
    """Whoever owns the vehicle's world and its clock."""

    def exchange(self, act: Callable[[int], List[Tuple[str, Any]]]) -> List[Tuple[str, Any]]:
        """Bring the world to the present time and call `act` with it, while nobody else touches the world."""


class _Peer(NamedTuple):
    """The other end of a connection."""

    port: socket.socket
    place: _Place
    framing: Framing


class VehicleServer:
    """Serves one simulated PX4.

    Args:
        px4: it.
        addresses: udpin: and udpout: URLs.
        owner: of the world.
        preset: of the rates of new connections: onboard or gcs.
        mute: names connections (a component that was heard on them) that are cut at this moment.

    Raises:
        VehicleAddressError: an address cannot be served.
    """

    def __init__(
        self,
        px4: Px4,
        addresses: Tuple[str, ...],
        owner: VehicleTime,
        preset: str = "onboard",
        mute: Callable[[int], bool] = lambda _: False,
    ) -> None:
        self._px4, self._owner, self._preset, self._mute = px4, owner, preset, mute
        self._peers: Dict[str, _Peer] = {}
        self._heard: Dict[str, int] = {}
        self._waiting: List[socket.socket] = []
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name="vehicle", daemon=True)
        try:
            for address in addresses:
                self._open(address)
        except VehicleAddressError:
            self._close()
            raise

    @property
    def ports(self) -> Tuple[int, ...]:
        """The UDP port of each address, in order."""
        return tuple(int(port.getsockname()[1]) for port in self._waiting)

    def start(self) -> None:
        """Serve from now on."""
        self._thread.start()

    def stop(self) -> None:
        """Stop, and close the sockets."""
        self._stopped.set()
        if self._thread.is_alive():
            self._thread.join(5.0)
        self._close()

    def run(self, stopped: threading.Event) -> None:
        """Serve on this thread until an event is set."""
        while not stopped.is_set():
            self._step()
        self._close()

    # --- sockets --------------------------------------------------------------------------------------------------

    def _open(self, address: str) -> None:
        endpoint = _endpoint(address)
        port = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        port.setblocking(False)
        self._waiting.append(port)
        place = (endpoint.address, endpoint.number)
        try:
            port.bind(place if endpoint.kind is EndpointKind.UDP_IN else ("", 0))
        except OSError as error:
            raise VehicleAddressError(address, error.strerror or str(error)) from error
        if endpoint.kind is EndpointKind.UDP_OUT:
            with contextlib.suppress(OSError):
                place = (socket.gethostbyname(endpoint.address), endpoint.number)
            self._meet(port, place)

    def _close(self) -> None:
        for port in self._waiting:
            port.close()

    def _meet(self, port: socket.socket, place: _Place) -> Optional[str]:
        """Return the name of the connection to a place; None when there are too many already."""
        name = f"{place[0]}:{place[1]}"
        if name not in self._peers:
            if len(self._peers) >= _PEERS_MAX:
                return None
            self._peers[name] = _Peer(port, place, Framing(self._px4.settings.system, 1))
            self._px4.connect(name, self._preset)
        return name

    # --- the loop -------------------------------------------------------------------------------------------------

    def _run(self) -> None:
        while not self._stopped.is_set():
            try:
                self._step()
            except Exception:  # noqa: BLE001 - whatever it is, the others are still served
                _log.exception("the simulated vehicle failed")
                time.sleep(_SLICE_S)

    def _step(self) -> None:
        readable, _, _ = select.select(self._waiting, [], [], _SLICE_S)
        came = [datagram for port in readable for datagram in _datagrams(port)]
        out = self._owner.exchange(lambda t_ns: self._exchange(t_ns, came))
        for name, message in out:
            self._send(name, message)
        if came:
            time.sleep(_LEAST_S)  # many small datagrams are better taken together

    def _exchange(self, t_ns: int, came: List[Tuple[socket.socket, _Place, bytes]]) -> List[Tuple[str, Any]]:
        for port, place, data in came:
            name = self._meet(port, place)
            if name is None:
                continue
            for message in self._peers[name].framing.decode(data):
                self._heard[name] = message.get_srcComponent()
                if not self._cut(name):
                    self._px4.receive(t_ns, name, message)
        return self._px4.advance(t_ns)

    def _cut(self, name: str) -> bool:
        return name in self._heard and self._mute(self._heard[name])

    def _send(self, name: str, message: Any) -> None:
        peer = self._peers.get(name)
        if peer is None or self._cut(name):
            return
        with contextlib.suppress(OSError):  # nobody is there, or the buffer is full: as on any radio
            peer.port.sendto(peer.framing.encode(message), peer.place)


def _datagrams(port: socket.socket) -> List[Tuple[socket.socket, _Place, bytes]]:
    """Return what has come to a socket."""
    came: List[Tuple[socket.socket, _Place, bytes]] = []
    while True:
        try:
            data, place = port.recvfrom(_BYTES)
        except BlockingIOError:
            return came
        except OSError:
            continue  # an earlier datagram met a closed port
        came.append((port, place, data))


def _endpoint(address: str) -> Endpoint:
    try:
        endpoint = parse_endpoint(address)
    except EndpointError as error:
        raise VehicleAddressError(address, str(error)) from error
    if endpoint.kind not in (EndpointKind.UDP_IN, EndpointKind.UDP_OUT):
        raise VehicleAddressError(address, "must be udpin:HOST:PORT or udpout:HOST:PORT")
    return endpoint
