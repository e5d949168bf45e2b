// The noise of the shading language. SPDX-License-Identifier: MIT OR Apache-2.0

#ifndef GELATO_NOISE_H
#define GELATO_NOISE_H

#include "export.h"
#include "gelato_c.h"

extern "C" {
#if defined(__GNUC__)
// The renderer that loads a plugin sets the function of the noise. A program takes it from libgelato.
__attribute__((weak, visibility("hidden"))) gelato_noise_function gelato_bound_noise = 0;
__attribute__((weak, visibility("default"))) void gelato_bind_noise (gelato_noise_function noise)
{
    gelato_bound_noise = noise;
}
void gelato_noise (int kind, int indim, const float *in, const float *period, int outdim, float *out)
    __attribute__((weak));
#endif
}

namespace Gelato {

namespace Noise {

// Computes noise of any kind. The result is 0 when there is neither a renderer nor libgelato.
inline void gelato_any_noise (int kind, int indim, const float *in, const float *period, int outdim, float *out)
{
    if (gelato_bound_noise) {
        gelato_bound_noise (kind, indim, in, period, outdim, out);
    } else if (gelato_noise) {
        gelato_noise (kind, indim, in, period, outdim, out);
    } else {
        for (int i = 0; i < outdim; ++i)
            out[i] = 0;
    }
}

inline float gelato_one (int kind, int indim, const float *in, const float *period)
{
    float out = 0;
    gelato_any_noise (kind, indim, in, period, 1, &out);
    return out;
}

// noise is smooth, from 0 to 1. snoise is smooth, from -1 to 1. cnoise has one value for each cell. pnoise is periodic
// noise, and psnoise periodic snoise.
#define GELATO_PLAIN_NOISE(name, kind) \
    inline float name (float x) { return gelato_one (kind, 1, &x, 0); } \
    inline float name (float x, float y) { const float in[] = { x, y }; return gelato_one (kind, 2, in, 0); } \
    inline float name (float x, float y, float z) { const float in[] = { x, y, z }; return gelato_one (kind, 3, in, 0); } \
    inline float name (float x, float y, float z, float t) \
    { const float in[] = { x, y, z, t }; return gelato_one (kind, 4, in, 0); } \
    inline void name (int indim, float *in, int outdim, float *out) { gelato_any_noise (kind, indim, in, 0, outdim, out); }
GELATO_PLAIN_NOISE (noise, GELATO_NOISE)
GELATO_PLAIN_NOISE (snoise, GELATO_SNOISE)
GELATO_PLAIN_NOISE (cnoise, GELATO_CNOISE)
#undef GELATO_PLAIN_NOISE

inline float pnoise (float x, float xper) { return gelato_one (GELATO_PNOISE, 1, &x, &xper); }
inline float pnoise (float x, float y, float xper, float yper)
{
    const float in[] = { x, y }, per[] = { xper, yper };
    return gelato_one (GELATO_PNOISE, 2, in, per);
}
inline float pnoise (float x, float y, float z, float xper, float yper, float zper)
{
    const float in[] = { x, y, z }, per[] = { xper, yper, zper };
    return gelato_one (GELATO_PNOISE, 3, in, per);
}
inline float pnoise (float x, float y, float z, float t,
                     float xper, float yper, float zper, float tper)
{
    const float in[] = { x, y, z, t }, per[] = { xper, yper, zper, tper };
    return gelato_one (GELATO_PNOISE, 4, in, per);
}
inline void pnoise (int indim, float *in, float *per, int outdim, float *out)
{
    gelato_any_noise (GELATO_PNOISE, indim, in, per, outdim, out);
}
inline void psnoise (int indim, float *in, float *per, int outdim, float *out)
{
    gelato_any_noise (GELATO_PSNOISE, indim, in, per, outdim, out);
}

} /* end namespace Noise */

} /* end namespace Gelato */

#endif /* GELATO_NOISE_H */
