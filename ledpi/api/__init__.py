"""Names that `import ledpi` offers to Python programs: a reader of pictures, its lens, the markers that it finds."""

from ledpi.api.exposed import Reason
from ledpi.api.lens import Lens
from ledpi.api.marker import Fix, Marker
from ledpi.api.reader import Reader, Stream
from ledpi.api.state import State

__all__ = ["Fix", "Lens", "Marker", "Reader", "Reason", "State", "Stream"]
