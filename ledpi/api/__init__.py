"""Names that `import ledpi` offers to Python programs: a reader of pictures, its lens, the markers that it finds."""

from ledpi.api.fix import Fix
from ledpi.api.lens import Lens
from ledpi.api.marker import Marker
from ledpi.api.reader import Reader
from ledpi.api.reason import Reason
from ledpi.api.state import State
from ledpi.api.stream import Stream

__all__ = ["Fix", "Lens", "Marker", "Reader", "Reason", "State", "Stream"]
