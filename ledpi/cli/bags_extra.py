"""The packages that bags need beyond ledpi."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from ledpi.core.errors import InstallationError
from ledpi.core.wording import install_command


@contextmanager
def needs_bags() -> Iterator[None]:
    """Around an import. Raises InstallationError, which names the extra."""
    try:
        yield
    except ImportError as error:
        raise InstallationError(f"bags need the package {error.name}: {install_command('bags')}") from None
