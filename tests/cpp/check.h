// Assertions for the programs of the tests.
#ifndef CHECK_H
#define CHECK_H

#include <stdio.h>
#include <stdlib.h>

#define CHECK(what) do { if (! (what)) { fprintf (stderr, "line %d: %s\n", __LINE__, #what); exit (1); } } while (0)

#endif
