"""labkit's server inside YADE: holds the grains of one State, moves them, and answers with their stress or State.

    yade -n -x -j2 yade_scripts/server.py FD     serves the open socket with this number; labkit starts it this way

The scripts that start labkit themselves serve it too (start_labkit.py). Only numpy and YADE are needed here: labkit's
laws arrive as names of YADE's classes with their arguments. A message, in either direction, consists of

    4 bytes    length of the header, little-endian
    header     JSON {"name": "advance", "values": {"steps": 10}, "arrays": [["velocity_gradient", "<f8", [3, 3]]]}
    arrays     the bytes of each array of the header, in C order

The server starts with `hello` (protocol, version, threads), and then answers each message with one of the same name:

    load           a State, its law and time step   -> stress, cell
    advance        steps; velocity_gradient         -> stress, cell; preceded by `alive` if it takes long
    stress                                          -> stress, cell
    state                                           -> grains and contacts; time, work on the cell and losses since load
    stop_grains                                     -> kinetic energy lost, J
    quit           ends the server, as does the end of the socket; it is not answered

or with `error` and a text. SI units; stress positive in compression; contacts in any order. The history
of contacts, vectors on the first grain, has the names that labkit gives with the law.

The cycle of YADE's engines is rotated so that a time step starts with the motion: Newton, reset, collider, forces.
Positions, cell, overlaps and forces between two steps then belong to the same instant, and a velocity gradient set
there applies to cell and grains in the same step. The cyclic order is YADE's own.
"""

import gc
import json
import secrets
import signal
import socket
import socketserver
import struct
import sys
import time

import numpy as np
from yade import Matrix3, Quaternion, Vector3, config, utils, wrapper

PROTOCOL = 2
SILENCE = 10.0  # s, after which a long `advance` reports that it is alive
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def send(peer, name, values=None, **arrays):
    """Send a message; the end of the socket raises OSError."""
    arrays = {key: np.asarray(value) for key, value in arrays.items()}
    listed = [(key, array.dtype.str, array.shape) for key, array in arrays.items()]
    header = json.dumps({"name": name, "values": values or {}, "arrays": listed}).encode()
    peer.sendall(b"".join([struct.pack("<I", len(header)), header, *(array.tobytes() for array in arrays.values())]))


def receive(peer):
    """Return the next message: name, values, arrays. Raises EOFError at the end of the socket."""
    header = json.loads(_read(peer, struct.unpack("<I", _read(peer, 4))[0]).decode())
    arrays = {}
    for name, kind, shape in header["arrays"]:
        kind = np.dtype(kind)
        content = _read(peer, kind.itemsize * int(np.prod(shape, dtype=np.int64)))
        arrays[name] = np.frombuffer(content, kind).reshape(shape)
    return header["name"], header["values"], arrays


def _read(peer, size):
    content = bytearray(size)
    view = memoryview(content)
    while view:
        count = peer.recv_into(view)
        if not count:
            raise EOFError
        view = view[count:]
    return content


def build(call):
    """Build the YADE object that a pair [class name, {argument: value}] describes; values may be such pairs."""
    name, arguments = call
    given = {key: build(value) if isinstance(value, list) else value for key, value in arguments.items()}
    return getattr(wrapper, name)(**given)


def matrix(values):
    """Convert (3, 3) to a YADE matrix."""
    return Matrix3(*np.asarray(values, dtype=float).ravel().tolist())


def components(vectors):
    """Convert YADE vectors to an array (n, 3); indexing them is ten times faster than unpacking or np.array."""
    return np.array([(v[0], v[1], v[2]) for v in vectors], dtype=float).reshape(-1, 3)


class Server:
    """YADE with the grains of one State. Each public method answers the message of its name."""

    def __init__(self, peer):
        """Take the socket to labkit."""
        self._peer, self._omega = peer, wrapper.Omega()

    def load(self, values, arrays):
        omega = self._omega
        omega.reset()
        law = self._law = values["law"]
        geometry, physics, self._functor = (build(law[name]) for name in ("geometry", "physics", "law"))
        self._time, self._time_step, self._work = values["time"], values["time_step"], 0.0
        omega.periodic = True
        omega.cell.setBox(1, 1, 1)
        omega.cell.hSize = matrix(arrays["cell"])
        self._add_grains(values, arrays)
        self._clumps = self._add_clumps(arrays) if "clump" in arrays else []
        gradient = matrix(arrays["velocity_gradient"])
        omega.cell.updateAttrs({"velGrad": gradient, "prevVelGrad": gradient})
        newton = wrapper.NewtonIntegrator(damping=values["damping"], prevVelGrad=gradient, warnNoForceReset=False)
        forces = [
            wrapper.ForceResetter(),
            wrapper.InsertionSortCollider([wrapper.Bo1_Sphere_Aabb()], verletDist=values["verlet_distance"]),
            wrapper.InteractionLoop([geometry], [physics], [self._functor]),
        ]
        omega.engines = [newton, *forces]
        newton.dead = True
        omega.dt = law["loading_step"]  # finds the contacts without motion and without an increment of their history
        omega.step()
        self._set_history(arrays)
        omega.forces.f(0, True)  # sums the forces as Newton would: YADE resets only summed forces
        omega.step()
        newton.dead = False
        omega.dt = self._time_step
        omega.trackEnergy = True
        self._stress = self._sum_stress()
        return self.stress()

    def _add_grains(self, values, arrays):
        """Add the bodies in the order of the state, in which grains close in space are close in memory."""
        materials = [build(call) for call in values["materials"]]
        names = ("material", "radius", "position", "velocity", "angular_velocity")
        for kind, radius, position, velocity, spin in zip(*(arrays[name].tolist() for name in names), strict=True):
            grain = utils.sphere(position, radius, material=materials[kind])
            grain.state.vel = velocity
            grain.state.angVel = spin
            if values["blocked"]:
                grain.state.blockedDOFs = values["blocked"]
            self._omega.bodies.append(grain)
        self._grains = len(arrays["radius"])

    def _add_clumps(self, arrays):
        """Join spheres to rigid clumps; return (clump, its members, rotation from labkit's axes to YADE's) of each.

        YADE finds centre and axes of a clump from the masses of its members. Four heavy bodies on the axes that labkit
        gives, which are deleted afterwards, make it find these.
        """
        bodies, members = self._omega.bodies, {}
        for grain, clump in enumerate(arrays["clump"].tolist()):
            if clump >= 0:
                members.setdefault(clump, []).append(grain)
        heavy = wrapper.FrictMat(density=1e30)
        names = ("body_position", "body_velocity", "orientation", "angular_momentum", "mass", "inertia")
        clumps = []
        rows = zip(*(arrays[f"clump_{name}"].tolist() for name in names), strict=True)
        for number, (position, velocity, turn, momentum, mass, inertia) in enumerate(rows):
            center, own = Vector3(*position), Quaternion(*turn)
            size = bodies[members[number][0]].shape.radius
            places = [
                center + own * Vector3(*(sign * size * (3 - k) * np.eye(3)[k])) for k in (0, 1) for sign in (-1, 1)
            ]
            extra = [bodies.append(utils.sphere(place, size, material=heavy)) for place in places]
            body = bodies[bodies.clump(members[number] + extra, 0)]
            for one in extra:
                bodies.erase(one)
            body.state.mass, body.state.inertia = mass, inertia
            body.state.vel, body.state.angMom = velocity, momentum
            body.state.angVel = bodies[members[number][0]].state.angVel
            clumps.append((body, members[number], body.state.ori.conjugate() * own))
        return clumps

    def _set_history(self, arrays):
        """Copy the vectors of history, which belong to the first grain, to YADE's contacts."""
        row = {tuple(pair): k for k, pair in enumerate(arrays["contact_grain"].tolist())}
        for contact in self._omega.interactions:
            first, second = contact.id1, contact.id2
            sign = -1.0  # YADE stores the force on the second grain
            if (first, second) not in row:
                first, second, sign = second, first, 1.0
            if (first, second) in row:
                for column, attribute in self._law["history"].items():
                    value = arrays[column][row[first, second]]
                    setattr(contact.phys, attribute, Vector3(*(sign * value)))

    def advance(self, values, arrays):
        omega, steps, gradient = self._omega, values["steps"], arrays["velocity_gradient"]
        omega.cell.updateAttrs({"velGrad": matrix(gradient)})
        gas = omega.interactions.countReal() < self._grains - sum(len(members) - 1 for _, members, _ in self._clumps)
        for part in [1] * steps if gas else [steps]:  # else collisions in a gas would be missed between two sums
            self._step(part)
            self._time += part * self._time_step
            before, self._stress = self._stress, self._sum_stress()
            strain = -gradient * part * self._time_step
            self._work += omega.cell.volume * float(np.sum(0.5 * (before + self._stress) * strain.T))
        return self.stress()

    def _step(self, steps):
        step, now = self._omega.step, time.monotonic
        due = now() + SILENCE
        for _ in range(steps):
            step()
            if now() > due:
                send(self._peer, "alive")
                due = now() + SILENCE

    def _sum_stress(self):
        return -np.array(utils.getStress(), dtype=float).reshape(3, 3).T  # uses the centres of clumps

    def stress(self, values=None, arrays=None):
        """Return the stress summed at the end of the last `load` or `advance`."""
        return {}, {"stress": self._stress, "cell": self._cell()}

    def _cell(self):
        return np.array(self._omega.cell.hSize, dtype=float).reshape(3, 3)

    def stop_grains(self, values, arrays):
        energy = utils.kineticEnergy()
        utils.calm()
        return {"kinetic_energy": energy}, {}

    def state(self, values, arrays):
        gc.disable()  # collecting the many small objects created here would double the time
        try:
            grains = [self._omega.bodies[k].state for k in range(self._grains)]
            contacts = list(self._omega.interactions)
            physics = [contact.phys for contact in contacts]
            return {"time": self._time, "work": self._work, "losses": self._losses()}, {
                "position": components([grain.pos for grain in grains]),
                "velocity": components([grain.vel for grain in grains]),
                "angular_velocity": components([grain.angVel for grain in grains]),
                "cell": self._cell(),
                "velocity_gradient": np.array(self._omega.cell.velGrad, dtype=float).reshape(3, 3),
                "contact_grain": np.array([(c.id1, c.id2) for c in contacts], np.int32).reshape(-1, 2),
                "contact_shift": components([c.cellDist for c in contacts]).astype(np.int32),
                **{
                    column: -components([getattr(one, attribute) for one in physics])
                    for column, attribute in self._law["history"].items()
                },
                **self._clump_motion(),
            }
        finally:
            gc.enable()

    def _clump_motion(self):
        if not self._clumps:
            return {}
        states = [(body.state, body.state.ori * turn) for body, _, turn in self._clumps]
        return {
            "clump_body_position": components([state.pos for state, _ in states]),
            "clump_body_velocity": components([state.vel for state, _ in states]),
            "clump_orientation": np.array([(q[3], q[0], q[1], q[2]) for _, q in states]),
            "clump_angular_momentum": components([state.angMom for state, _ in states]),
        }

    def _losses(self):
        """Return friction, rolling and damping losses since `load`, J, from YADE's energy tracker and the functor."""
        tracked = dict(self._omega.energy.items())
        return [
            tracked.get(name, 0.0) + sum(getattr(self._functor, one) for one in attributes)
            for name, attributes in self._law["losses"]
        ]

    def serve(self):
        """Answer until labkit ends, or announces that it will."""
        values = {"protocol": PROTOCOL, "version": config.version, "threads": self._omega.numThreads}
        try:
            send(self._peer, "hello", values)
            while True:
                name, values, arrays = receive(self._peer)
                if name == "quit":
                    return
                try:
                    values, arrays = getattr(self, name)(values, arrays)
                except OSError:  # from `alive`
                    return
                except Exception as error:
                    name, values, arrays = "error", {"text": f"YADE stopped: {type(error).__name__}: {error}"}, {}
                send(self._peer, name, values, **arrays)
        except (EOFError, OSError):
            return


def close_ports():
    """Close the Python prompt and the information service that YADE's main program opens to the network."""
    for server in [one for one in gc.get_objects() if issubclass(type(one), socketserver.BaseServer)]:
        server.cookie = secrets.token_hex()  # of a prompt whose connection is already open
        server.socket.shutdown(socket.SHUT_RDWR)  # stops listening at once, and wakes the thread that listens
        server.shutdown()
        server.server_close()


if __name__ == "__main__":
    for number in SIGNALS:  # from a terminal or a queue: labkit decides how to stop, and then closes the socket
        signal.signal(number, signal.SIG_IGN)
    close_ports()
    Server(socket.socket(fileno=int(sys.argv[1]))).serve()
