// Writes patches with all pairs of bases, and one with an unknown basis.
#include <string>

#include "check.h"
#include "gelatoapi.h"

int main ()
{
    const char *const bases[4] = { "linear", "bezier", "bspline", "catmull-rom" };
    float P[48];
    for (int i = 0; i < 48; ++i)
        P[i] = (float) i;
    GelatoAPI *r = GelatoAPI::CreateRenderer ("patches.pyg");
    CHECK (r);
    r->World ();
    for (int i = 0; i < 16; ++i) {
        r->Parameter ("vertex point P", P);
        r->Patch ((std::string (bases[i / 4]) + "," + bases[i % 4]).c_str (), 4, 4);
    }
    r->Parameter ("vertex point P", P);
    r->Patch ("bezier, spline", 4, 4);
    delete r;
    return 0;
}
