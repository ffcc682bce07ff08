"""Why a panel is not read, in words: for people who look at a picture, never for the path that reads it."""
