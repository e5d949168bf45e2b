// A generator: Input ("spiral 200 0.05") makes 200 spheres of radius 0.05 on a spiral.
//     g++ -shared -fPIC -o spiral.generator.so -I$GELATOHOME/include spiral.cpp
#include <math.h>
#include <stdio.h>

#include "gelatoapi.h"

class Spiral : public GelatoAPI::Generator {
public:
    explicit Spiral (const char *command) : count (100), radius (0.05f) {
        sscanf (command, "%*s %d %f", &count, &radius);
        if (count < 0 || count > 1000000)
            count = 0;
    }

    // The bound is known at once, so that the spheres are not made for a camera that does not see it.
    bool bound (float *box) {
        for (int i = 0; i < 3; ++i) {
            box[2 * i] = -1 - radius;
            box[2 * i + 1] = 1 + radius;
        }
        return true;
    }

    void run (GelatoAPI *r, const char *params) {
        if (count == 0)
            r->Err ().Warning ("spiral: \"%s\" asks for no spheres", params);
        for (int i = 0; i < count; ++i) {
            float t = (float) i / count, angle = 40 * t;
            const float color[3] = { t, 0.5f, 1 - t };
            r->PushAttributes ();
            r->Attribute ("C", color);
            r->Translate (t * cosf (angle), 1 - 2 * t, t * sinf (angle));
            r->Sphere (radius);
            r->PopAttributes ();
        }
    }

private:
    int count;
    float radius;
};

extern "C" {
GELATO_EXPORT int generator_version = GelatoAPI::API_VERSION;
GELATO_EXPORT GelatoAPI::Generator *spiral_generator_create (const char *command) { return new Spiral (command); }
}
