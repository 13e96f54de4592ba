"""What concerns the process and the system: signals, locks, threads, progress, optional libraries."""

from typing import TYPE_CHECKING

from labkit.lazy import attach

if TYPE_CHECKING:
    from labkit.process.children import die_with_parent as die_with_parent
    from labkit.process.children import without_current_folder as without_current_folder
    from labkit.process.extras import install_command as install_command
    from labkit.process.interruption import lock_of as lock_of
    from labkit.process.interruption import resumed_from as resumed_from
    from labkit.process.progress import reporter as reporter
else:
    __getattr__, __dir__, __all__ = attach(__name__)
