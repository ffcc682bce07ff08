"""Names that `import ledpi` offers to Python programs: a reader of pictures, its lens, the markers that it finds."""

from ledpi.pipeline.api.exposed import Reason
from ledpi.pipeline.api.lens import Lens
from ledpi.pipeline.api.marker import Body, Fix, Marker
from ledpi.pipeline.api.reader import Reader, Stream
from ledpi.pipeline.api.state import State

__all__ = ["Body", "Fix", "Lens", "Marker", "Reader", "Reason", "State", "Stream"]
