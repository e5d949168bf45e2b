// Shadeops of all kinds: strings, arrays, matrices, outputs, symbols, attributes, noise, lookups, errors.
#include <math.h>
#include <stdexcept>

#include "noise.h"
#include "shadeop.h"

using namespace Gelato;

extern "C" {

GELATO_EXPORT int shadeop_version = SHADEOP_VERSION;

// Returns 1 when the noise of the shader equals that of the header.
GELATO_EXPORT const char *same_noise_shadeop[] = { "float same_noise (point, float, float, float)", NULL };
GELATO_EXPORT int same_noise_threadsafe = 1;
GELATO_EXPORT void same_noise (ShadingExecution *exec, int nargs, const ShaderArg *args)
{
    for (ShadeGridIter i (exec, exec->isvarying (args[0])); ! i.done (); i++) {
        float *r = (float *) args[0].data (i), *p = (float *) args[1].data (i);
        float n = *(float *) args[2].data (i), s = *(float *) args[3].data (i), q = *(float *) args[4].data (i);
        r[0] = n == Noise::noise (p[0], p[1], p[2]) && s == Noise::snoise (p[0]) && q == Noise::pnoise (p[0], 3);
    }
}

// Joins a name and a number, and stores the length of the result.
GELATO_EXPORT const char *label_shadeop[] = { "string label (string, float, output float)", NULL };
GELATO_EXPORT void label (ShadingExecution *exec, int nargs, const ShaderArg *args)
{
    for (ShadeGridIter i (exec, exec->isvarying (args[0])); ! i.done (); ++i) {
        char text[100];
        const char **r = (const char **) args[0].data (i), **s = (const char **) args[1].data (i);
        float *length = (float *) args[3].data (i);
        sprintf (text, "%s%g", s[0], floorf (*(float *) args[2].data (i)));
        r[0] = exec->tokenize (text);
        *length = (float) strlen (text);
    }
}

// Returns the sum of an array, or of the diagonal of a matrix. These are two forms of one function.
GELATO_EXPORT const char *total_shadeop[] = { "float total3 (float[3])", "float trace (matrix)", NULL };
GELATO_EXPORT void total3 (ShadingExecution *exec, int nargs, const ShaderArg *args)
{
    for (ShadeGridIter i (exec, exec->isvarying (args[0])); ! i.done (); ++i) {
        float *v = (float *) args[1].data (i);
        *(float *) args[0].data (i) = v[0] + v[1] + v[2];
    }
    if (! exec->type (args[1]).isarray || exec->type (args[1]).arraylen != 3 || exec->type (args[1]).basetype != PT_FLOAT)
        exec->Error ("type %d", (int) exec->type (args[1]).basetype);
}
GELATO_EXPORT void trace (ShadingExecution *exec, int nargs, const ShaderArg *args)
{
    for (ShadeGridIter i (exec, exec->isvarying (args[0])); ! i.done (); ++i) {
        float *m = (float *) args[1].data (i);
        *(float *) args[0].data (i) = m[0] + m[5] + m[10] + m[15];
    }
}

// Stores the index of the point. The result is varying although no argument is.
GELATO_EXPORT const char *number_shadeop[] = { "void number (output float)", NULL };
GELATO_EXPORT void number (ShadingExecution *exec, int nargs, const ShaderArg *args)
{
    if (! exec->forcevarying (args[0]) || exec->stride (args[0]) != 1)
        throw std::runtime_error ("still uniform");
    const ShaderRunFlag *active = exec->active ();
    for (int i = exec->begin (); i != exec->end (); ++i)
        if (active[i])
            *(float *) exec->data (args[0], i) = (float) i;
}

// Checks the symbols, attributes and ray of the shader. Each bit of the result is one check.
GELATO_EXPORT const char *surroundings_shadeop[] = { "float surroundings (float)", NULL };
GELATO_EXPORT void surroundings (ShadingExecution *exec, int nargs, const ShaderArg *args)
{
    ShaderArg u = args[0], nothing = args[0], kd = args[0];
    int bits = 0;
    float color[3], temperature = 0;
    const char *name = NULL;
    bits |= exec->getsymbol ("u", u) ? 1 : 0;
    bits |= exec->getsymbol ("nosuch", nothing) ? 0 : 2;
    bits |= exec->getsymbol ("Kd", kd) && *(float *) exec->data (kd) == 0.25f ? 4 : 0;
    bits |= exec->getattribute ("C", PT_COLOR, color) && color[0] == 1 ? 8 : 0;
    bits |= exec->getattribute ("user:temperature", PT_FLOAT, &temperature) && temperature == 98.5f ? 16 : 0;
    bits |= exec->getattribute ("name", PT_STRING, &name) && name && ! strcmp (name, "ball") ? 32 : 0;
    bits |= exec->getattribute ("user:temperature", ParamType (PT_FLOAT, 2), color) ? 0 : 64;
    bits |= exec->raylevel () == 0 && ! exec->isshadowray () && ! exec->isindirectray () ? 128 : 0;
    for (ShadeGridIter i (exec, exec->isvarying (args[0])); ! i.done (); ++i) {
        float same = *(float *) u.data (i) == *(float *) args[1].data (i) ? 256 : 0;
        *(float *) args[0].data (i) = bits + same;
    }
}

// Looks up a texture, and checks its size.
GELATO_EXPORT const char *looked_shadeop[] = { "color looked (string, float, float)", NULL };
GELATO_EXPORT void looked (ShadingExecution *exec, int nargs, const ShaderArg *args)
{
    float resolution[2] = { 0, 0 }, width = 0.5f;
    const char *names[] = { "width", "wrap" };
    const char *wrap = "clamp";
    void *data[] = { &width, &wrap };
    for (ShadeGridIter i (exec, exec->isvarying (args[0])); ! i.done (); ++i) {
        const char *file = *(const char **) args[1].data (i);
        float *r = (float *) args[0].data (i);
        exec->texture (file, 0, 3, *(float *) args[2].data (i), *(float *) args[3].data (i), 0, 0, 0, 0, r, 2, names, data);
        exec->texture (file, 0, 3, *(float *) args[2].data (i), *(float *) args[3].data (i), 0, 0, 0, 0, r, 0, NULL, NULL);
        if (! exec->gettextureinfo (file, "resolution", ParamType (PT_FLOAT, 2), resolution) || resolution[0] != 8)
            exec->Error ("resolution %g", resolution[0]);
    }
}

// Traces a ray towards -z against a geometry set.
GELATO_EXPORT const char *behind_shadeop[] = { "color behind (string)", NULL };
GELATO_EXPORT void behind (ShadingExecution *exec, int nargs, const ShaderArg *args)
{
    const float back[3] = { 0, 0, -1 }, still[3] = { 0, 0, 0 };
    for (ShadeGridIter i (exec, exec->isvarying (args[0])); ! i.done (); ++i)
        exec->environment (*(const char **) args[1].data (i), 0, 3, back, still, still, (float *) args[0].data (i), 0, NULL, NULL);
}

GELATO_EXPORT const char *wrong_shadeop[] = { "float wrong (float)", NULL };
GELATO_EXPORT void wrong (ShadingExecution *exec, int nargs, const ShaderArg *args)
{
    exec->Error ("told %d", 7);
    throw std::runtime_error ("no use");
}

}
