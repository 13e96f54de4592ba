"""Scalar quantities of a record by name, conditions on these quantities, and user-defined statistics."""

from typing import TYPE_CHECKING

from labkit.lazy import attach

if TYPE_CHECKING:
    from labkit.quantities.conditions import Condition as Condition
    from labkit.quantities.conditions import condition as condition
    from labkit.quantities.recorded import quantity as quantity
    from labkit.quantities.scalars import QUANTITIES as QUANTITIES
    from labkit.quantities.scalars import Facts as Facts
    from labkit.quantities.scalars import Quantity as Quantity
else:
    __getattr__, __dir__, __all__ = attach(__name__)
