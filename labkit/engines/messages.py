"""Messages between labkit and an engine in another process: a name, plain values and named arrays.

    4 bytes    length of the header, little-endian
    header     JSON {"name": "advance", "values": {"steps": 10}, "arrays": [["velocity_gradient", "<f8", [3, 3]]]}
    arrays     the bytes of each array of the header, in C order

yade_scripts/server.py, which may not import labkit, has the same two functions and the list of all messages.
"""

from __future__ import annotations

import json
import math
import socket
import struct
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

PROTOCOL = 1  # increased when messages change; both sides must have the same


class Message(NamedTuple):
    """One message, in either direction."""

    name: str
    values: Mapping[str, Any]  # as in JSON
    arrays: Mapping[str, np.ndarray]


def send(peer: socket.socket, message: Message) -> None:
    """Send a message. Raises OSError if the other side has ended."""
    arrays = {name: np.asarray(array) for name, array in message.arrays.items()}
    listed = [(name, array.dtype.str, array.shape) for name, array in arrays.items()]
    header = json.dumps({"name": message.name, "values": message.values, "arrays": listed}).encode()
    peer.sendall(b"".join([struct.pack("<I", len(header)), header, *(array.tobytes() for array in arrays.values())]))


def receive(peer: socket.socket) -> Message:
    """The next message. Raises EOFError if the other side has ended, TimeoutError if the socket has a limit."""
    header = json.loads(_read(peer, *struct.unpack("<I", _read(peer, 4))))
    arrays = {}
    for name, code, shape in header["arrays"]:
        kind = np.dtype(code)
        arrays[name] = np.frombuffer(_read(peer, kind.itemsize * math.prod(shape)), kind).reshape(shape)
    return Message(header["name"], header["values"], arrays)


def _read(peer: socket.socket, size: int) -> bytearray:
    content = bytearray(size)
    view = memoryview(content)
    while view:
        count = peer.recv_into(view)
        if not count:
            raise EOFError
        view = view[count:]
    return content
