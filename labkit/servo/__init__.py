"""The servo: adjusts strain rates so that measured stresses reach their targets."""

from typing import TYPE_CHECKING

from labkit.lazy import attach

if TYPE_CHECKING:
    from labkit.servo.correction import STANDARD as STANDARD
    from labkit.servo.correction import Servo as Servo
    from labkit.servo.correction import cell_stiffness as cell_stiffness
    from labkit.servo.plan import prescribed_gradient as prescribed_gradient
    from labkit.servo.plan import velocity_gradient as velocity_gradient
else:
    __getattr__, __dir__, __all__ = attach(__name__)
