/* Which sources were compiled: setup.py says. */
#ifndef LEDPI_SOURCES
#define LEDPI_SOURCES ""
#endif

const char *ledpi_sources(void) { return LEDPI_SOURCES; }
