// Measures the cost of calls from C++, in nanoseconds of processor time per call (the best of several rounds), and the
// memory of a mesh.
#include <algorithm>
#include <stdio.h>
#include <sys/resource.h>
#include <time.h>
#include <vector>

#include "gelatoapi.h"

// Returns the processor time of this thread, in seconds.
static double now ()
{
    struct timespec t;
    clock_gettime (CLOCK_THREAD_CPUTIME_ID, &t);
    return t.tv_sec + t.tv_nsec * 1e-9;
}

template <class F> static void measure (const char *what, int calls, F f)
{
    const int rounds = 7, n = 50000;
    double best = 1e30;
    for (int round = 0; round < rounds; ++round) {
        double begin = now ();
        for (int i = 0; i < n; ++i)
            f (i);
        best = std::min (best, (now () - begin) / n / calls);
    }
    printf ("%-44s %7.1f ns\n", what, best * 1e9);
}

// Returns the peak memory so far, in bytes.
static double peak ()
{
    struct rusage usage;
    getrusage (RUSAGE_SELF, &usage);
    return usage.ru_maxrss * 1024.0;
}

int main ()
{
    GelatoAPI *r = GelatoAPI::CreateRenderer ();
    if (! r)
        return 1;
    r->World ();
    Gelato::ParamType point (Gelato::PT_POINT, Gelato::INTERP_VERTEX);
    float p[3] = { 0, 0, 0 }, value = 0;
    const char *text = "it";
    measure ("Err ()", 1, [&] (int) { r->Err (); });
    measure ("Parameter, type in the name", 1, [&] (int i) { r->Parameter ("float Kd", (float) i); });
    measure ("Parameter, array with a ParamType", 1, [&] (int) { r->Parameter ("P", point, p); });
    r->Parameter ("string name", text);
    r->Command ("nothing");
    measure ("PushTransform, PopTransform", 2, [&] (int) { r->PushTransform (); r->PopTransform (); });
    r->PushTransform ();
    measure ("Translate", 1, [&] (int i) { r->Translate (0, 0, i & 1 ? 1.0f : -1.0f); });
    r->PopTransform ();
    measure ("Attribute, of the object", 1, [&] (int i) { r->Attribute ("shadingquality", i & 1 ? 1.0f : 0.5f); });
    measure ("GetAttribute, a float", 1, [&] (int) { r->GetAttribute ("shadingquality", value); });

    // The mesh has a million quadrilaterals, with 12 MB of points and 20 MB of integers.
    const int n = 1000;
    std::vector<float> points;
    std::vector<int> nverts (n * n, 4), verts;
    points.reserve (3 * (n + 1) * (n + 1));
    verts.reserve (4 * n * n);
    for (int y = 0; y <= n; ++y)
        for (int x = 0; x <= n; ++x) {
            points.push_back ((float) x);
            points.push_back ((float) y);
            points.push_back (0);
        }
    for (int y = 0; y < n; ++y)
        for (int x = 0; x < n; ++x) {
            int at = y * (n + 1) + x, corners[4] = { at, at + 1, at + n + 2, at + n + 1 };
            verts.insert (verts.end (), corners, corners + 4);
        }
    double bytes = (points.size () + nverts.size () + verts.size ()) * 4.0, before = peak ();
    double begin = now ();
    r->Parameter ("P", point, &points[0]);
    r->Mesh ("linear", n * n, &nverts[0], &verts[0]);
    double took = now () - begin;
    printf ("%-44s %7.1f MB in %.1f ms; memory grew by %.2f times that\n", "Mesh of a million faces", bytes / 1e6,
            took * 1e3, (peak () - before) / bytes);
    delete r;
    return 0;
}
