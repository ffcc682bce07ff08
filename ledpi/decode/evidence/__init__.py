"""From the light of a panel's cells to what it says of the bands in each, in one frame and in many."""
