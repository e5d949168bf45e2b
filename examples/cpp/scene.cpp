// A ring of spheres, rendered by a program. Writes ring.tif.
//     g++ -o scene scene.cpp -I$GELATOHOME/include -L$GELATOHOME/lib -lgelato -Wl,-rpath,$GELATOHOME/lib
#include <math.h>
#include <stdio.h>

#include "gelatoapi.h"

int main ()
{
    GelatoAPI *r = GelatoAPI::CreateRenderer ();
    if (r == NULL)
        return 1;
    int resolution[2] = { 320, 240 };
    r->Attribute ("resolution", resolution);
    r->Attribute ("fov", 30);
    r->Output ("ring.tif", "tiff", "rgba", "main");
    r->World ();
    r->Parameter ("float intensity", 0.1f);
    r->Light ("ambient", "ambientlight");
    const float from[3] = { -5, 8, -5 };
    r->Parameter ("point from", from);
    r->Parameter ("float intensity", 90.0f);
    r->Light ("key", "pointlight");
    r->Translate (0, 0, 14);
    r->Rotate (-25, 1, 0, 0);
    const int n = 12;
    for (int i = 0; i < n; ++i) {
        float angle = 6.2831853f * i / n;
        const float color[3] = { 0.5f + 0.5f * cosf (angle), 0.5f + 0.5f * sinf (angle), 0.4f };
        r->PushAttributes ();
        r->Attribute ("C", color);
        r->Shader ("surface", "plastic");
        r->Translate (3 * cosf (angle), 0, 3 * sinf (angle));
        r->Sphere (0.7f);
        r->PopAttributes ();
    }
    r->Render ();
    int good = 0;
    r->GetAttribute ("render:success", good);
    printf ("ring.tif %s\n", good ? "is done" : "is not complete");
    delete r;
    return ! good;
}
