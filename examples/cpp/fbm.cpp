// A shadeop: fbm (P, octaves), noise over noise. Called by marble.gsl.
//     g++ -shared -fPIC -o fbm.so -I$GELATOHOME/include fbm.cpp
#include "noise.h"
#include "shadeop.h"

using namespace Gelato;

extern "C" {

GELATO_EXPORT int shadeop_version = SHADEOP_VERSION;
// It has no data of its own, so that several threads may run it at once.
GELATO_EXPORT int fbm_threadsafe = 1;

GELATO_EXPORT const char *fbm_shadeop[] = {
    "float fbm (point, float)",
    NULL
};

GELATO_EXPORT void fbm (ShadingExecution *exec, int nargs, const ShaderArg *args)
{
    for (ShadeGridIter i (exec, exec->isvarying (args[0])); ! i.done (); ++i) {
        const float *p = (const float *) args[1].data (i);
        int octaves = (int) *(const float *) args[2].data (i);
        float sum = 0, scale = 1;
        for (int k = 0; k < octaves && k < 16; ++k, scale *= 2)
            sum += Noise::snoise (p[0] * scale, p[1] * scale, p[2] * scale) / scale;
        *(float *) args[0].data (i) = sum;
    }
}

}
