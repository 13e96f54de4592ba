"""How the normal, the contact point and the history of a contact move in a time step."""

from __future__ import annotations

from labkit.grains.laws.contact import Contact, ContactMotion
from labkit.grains.laws.vectors import Vector, across, cross, dot


def along_branch(contact: Contact, dt: float) -> Vector:
    """Return the contact normal at a time dt earlier; one Newton step normalises the branch."""
    branch = contact.branch - dt * contact.velocity
    return contact.inverse * (1.5 - 0.5 * dot(branch, branch) * contact.inverse * contact.inverse) * branch


class FirstOrder:
    """YADE's kinematics: the history rotates with the contact to first order; the slip is that of the contact point.

    When a pair rotates rigidly by the angle w dt in a step, its shear force creeps by up to pi/2 D w dt kt in a
    revolution. At w dt of 1e-6, as in tests, this is about 0.1 % of the elastic slip.
    """

    @staticmethod
    def move(contact: Contact, dt: float) -> ContactMotion:
        """Return the motion of a contact in the step that ends now."""
        n, a, b = contact.normal, contact.spin_a, contact.spin_b
        before = along_branch(contact, dt)
        half = 0.5 * contact.overlap
        surface = cross((contact.radius_a - half) * a + (contact.radius_b - half) * b, n)
        return ContactMotion(before, 0.5 * dt * dot(before, a + b), across(contact.velocity - surface, n))

    @staticmethod
    def carry(x: Vector, n: Vector, motion: ContactMotion) -> Vector:
        """Rotate a vector of the history with the contact."""
        x -= cross(x, cross(motion.before, n))
        return x - cross(x, motion.turn * motion.before)


class WithoutRatcheting(FirstOrder):
    """FirstOrder with the arms Ra and Rb and, to avoid ratcheting, the factor (Ra + Rb)/|d| on the centre velocity."""

    @staticmethod
    def move(contact: Contact, dt: float) -> ContactMotion:
        """Return the motion of a contact in the step that ends now."""
        n, a, b = contact.normal, contact.spin_a, contact.spin_b
        before = along_branch(contact, dt)
        ratio = (contact.radius_a + contact.radius_b) * contact.inverse
        surface = cross(contact.radius_a * a + contact.radius_b * b, n)
        return ContactMotion(before, 0.5 * dt * dot(before, a + b), across(ratio * contact.velocity - surface, n))


class Midpoint:
    """Kinematics of second order in dt: increments at mid-step and an exact rotation of the history.

    The history is rotated first by the smallest rotation from the previous normal to the current one, then about the
    normal with the mean spin of the two grains. The rotation preserves the lengths of vectors.
    """

    @staticmethod
    def move(contact: Contact, dt: float) -> ContactMotion:
        """Return the motion of a contact in the step that ends now; `turn` is half of the rotation about the normal."""
        n, v, a, b = contact.normal, contact.velocity, contact.spin_a, contact.spin_b
        halfway = along_branch(contact, 0.5 * dt)
        half = 0.5 * (contact.overlap + 0.5 * dt * dot(n, v))
        surface = cross((contact.radius_a - half) * a + (contact.radius_b - half) * b, halfway)
        slip = across(v, halfway) - surface
        return ContactMotion(along_branch(contact, dt), 0.25 * dt * dot(n, a + b), across(slip, n))

    @staticmethod
    def carry(x: Vector, n: Vector, motion: ContactMotion) -> Vector:
        """Rotate a vector perpendicular to the previous normal with the contact."""
        x -= dot(x, n) / (1.0 + dot(motion.before, n)) * (motion.before + n)
        square = motion.turn * motion.turn
        cosine, sine = (1.0 - square) / (1.0 + square), 2.0 * motion.turn / (1.0 + square)
        return cosine * x + sine * cross(n, x)


Kinematics = type[FirstOrder] | type[Midpoint]
