"""From the light of a panel's cells to the likelihood of bands in each, in one frame and in many."""
