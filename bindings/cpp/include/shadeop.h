// Functions in C++ that shaders call. SPDX-License-Identifier: MIT OR Apache-2.0

#ifndef SHADEOP_H
#define SHADEOP_H

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "export.h"
#include "gelato_c.h"
#include "paramtype.h"

namespace Gelato {

class GELATO_PUBLIC ShaderArg;

typedef short ShaderRunFlag;

// The library of a shadeop has: GELATO_EXPORT int shadeop_version = Gelato::SHADEOP_VERSION;
static const int SHADEOP_VERSION = 1;
#define SHADEOP_TYPE "shadeop"
// or: GELATO_EXPORT int shadeop_protocol = SHADEOP_PROTOCOL;
#define SHADEOP_PROTOCOL 1

// The run of a shader that calls a shadeop. A shadeop has this form, where argument 0 is the result, if there is one:
//     void shadeop (ShadingExecution *exec, int nargs, const ShaderArg *args)
class GELATO_PUBLIC ShadingExecution {
public:
    // Return the first active point of the grid, and the point after the last active one.
    int begin (void) { return execution.begin; }
    int end (void) { return execution.end; }

    // Returns a flag for each point, which is not 0 when the point is active.
    const ShaderRunFlag *active (void) { return execution.active; }

    ParamType type (ShaderArg arg);

    // Returns true when each point has its own value.
    bool isvarying (ShaderArg arg);

    // Gives each point its own value. Returns true when that was possible.
    bool forcevarying (ShaderArg arg);

    // Returns the value of a point.
    void *data (ShaderArg arg, int gridindex=0);

    // Returns the number of floats, or char pointers, from one point to the next; 0 when all points have one value.
    int stride (ShaderArg arg);

    // Returns the renderer's own copy of a string, which may be stored in a variable.
    const char *tokenize (const char *userstring) {
        return execution.calls->tokenize (&execution, userstring);
    }

    void Error (const char *format, ...);

    // Look up a value at one point. The parameters are those of the language, by name. Their data are floats or
    // strings.
    void texture (const char *filename, int firstchannel, int nchannels,
                  float s, float t, float dsdx, float dtdx,
                  float dsdy, float dtdy, float *result,
                  int nparams, const char *paramname[], void *paramdata[]) {
        const float at[6] = { s, t, dsdx, dtdx, dsdy, dtdy };
        execution.calls->lookup (&execution, 0, filename, firstchannel, nchannels, at, result,
                                 nparams, paramname, paramdata);
    }
    void shadow (const char *filename, int firstchannel, int nchannels,
                 const float *P, const float *dPdx,
                 const float *dPdy, float *result,
                 int nparams, const char *paramname[], void *paramdata[]) {
        directed (1, filename, firstchannel, nchannels, P, dPdx, dPdy, result, nparams, paramname, paramdata);
    }
    void environment (const char *filename, int firstchannel, int nchannels,
                      const float *R, const float *dRdx,
                      const float *dRdy, float *result,
                      int nparams, const char *paramname[], void *paramdata[]) {
        directed (2, filename, firstchannel, nchannels, R, dRdx, dRdy, result, nparams, paramname, paramdata);
    }
    // Do the same for names in an array of `char *`.
    template <class Char>
    void texture (const char *filename, int firstchannel, int nchannels,
                  float s, float t, float dsdx, float dtdx,
                  float dsdy, float dtdy, float *result,
                  int nparams, Char *paramname[], void *paramdata[]) {
        texture (filename, firstchannel, nchannels, s, t, dsdx, dtdx, dsdy, dtdy, result,
                 nparams, const_cast<const char **> (paramname), paramdata);
    }
    template <class Char>
    void shadow (const char *filename, int firstchannel, int nchannels,
                 const float *P, const float *dPdx, const float *dPdy, float *result,
                 int nparams, Char *paramname[], void *paramdata[]) {
        shadow (filename, firstchannel, nchannels, P, dPdx, dPdy, result,
                nparams, const_cast<const char **> (paramname), paramdata);
    }
    template <class Char>
    void environment (const char *filename, int firstchannel, int nchannels,
                      const float *R, const float *dRdx, const float *dRdy, float *result,
                      int nparams, Char *paramname[], void *paramdata[]) {
        environment (filename, firstchannel, nchannels, R, dRdx, dRdy, result,
                     nparams, const_cast<const char **> (paramname), paramdata);
    }

    // Return true when there is such a value of this type, and store it.
    bool gettextureinfo (const char *texturename, const char *paramname,
                         Gelato::ParamType type, void *result) {
        return execution.calls->gettextureinfo (&execution, texturename, paramname, bits (type), result) != 0;
    }
    bool getattribute (const char *name, Gelato::ParamType type, void *result) {
        return execution.calls->getattribute (&execution, name, bits (type), result) != 0;
    }

    // Finds a parameter or global of the shader, which may be read. When there is none, it returns false, and `symbol`
    // does not change.
    bool getsymbol (const char *name, ShaderArg &symbol);

    // Returns 0 for surfaces that the camera sees, 1 for their reflections, and so on.
    int raylevel (void) const { return execution.raylevel; }

    // Returns true when a shadow ray requests only the opacity.
    bool isshadowray (void) const { return execution.isshadowray != 0; }

    // Returns true when the shader runs for an indirect ray.
    bool isindirectray (void) const { return execution.isindirectray != 0; }

private:
    static unsigned int bits (ParamType type) {
        unsigned int b;
        memcpy (&b, &type, sizeof(b));
        return b;
    }
    void directed (int what, const char *filename, int firstchannel, int nchannels, const float *a, const float *dx,
                   const float *dy, float *result, int nparams, const char *paramname[], void *paramdata[]) {
        const float at[9] = { a[0], a[1], a[2], dx[0], dx[1], dx[2], dy[0], dy[1], dy[2] };
        execution.calls->lookup (&execution, what, filename, firstchannel, nchannels, at, result,
                                 nparams, paramname, paramdata);
    }
    gelato_argument &argument (ShaderArg arg);

    gelato_execution execution;
};

// Iterates over the active points of a grid, or once over a uniform computation.
class GELATO_PUBLIC ShadeGridIter {
public:
    ShadeGridIter (ShadingExecution *exec, bool vary) : exec(exec) {
        active = exec->active();
        if (vary) {
            i = exec->begin();
            end = exec->end();
        } else {
            i = 0;
            end = 1;
        }
    }

    // Returns the index of the point.
    int operator() (void) const { return i; }

    void operator++ (void) {
        do {
            ++i;
        } while (i < end && active[i] == 0);
    }
    void operator++ (int) { ++*this; }

    bool done (void) const { return (i >= end); }

private:
    ShadingExecution *exec;
    const ShaderRunFlag *active;
    int i, end;
    friend class ShaderArg;
};

// An argument or symbol.
class GELATO_PUBLIC ShaderArg {
public:
    // Returns the value at the point of the iterator.
    void *data (ShadeGridIter &iter) const {
        return iter.exec->data(*this,iter());
    }
private:
    int index;
    friend class ShadingExecution;
};

inline gelato_argument &ShadingExecution::argument (ShaderArg arg) { return execution.arguments[arg.index]; }

inline ParamType ShadingExecution::type (ShaderArg arg)
{
    ParamType t;
    memcpy ((void *) &t, &argument (arg).type, sizeof(t));
    return t;
}

inline bool ShadingExecution::isvarying (ShaderArg arg) { return argument (arg).varying != 0; }

inline bool ShadingExecution::forcevarying (ShaderArg arg)
{
    return argument (arg).varying || execution.calls->forcevarying (&execution, arg.index);
}

inline void *ShadingExecution::data (ShaderArg arg, int gridindex)
{
    gelato_argument &a = argument (arg);
    return (char *) a.data + (ptrdiff_t) gridindex * a.stride * a.item_bytes;
}

inline int ShadingExecution::stride (ShaderArg arg) { return argument (arg).stride; }

inline bool ShadingExecution::getsymbol (const char *name, ShaderArg &symbol)
{
    int found = execution.calls->getsymbol (&execution, name);
    if (found >= 0)
        symbol.index = found;
    return found >= 0;
}

inline void ShadingExecution::Error (const char *format, ...)
{
    char text[1024];
    va_list values;
    va_start (values, format);
    vsnprintf (text, sizeof(text), format ? format : "", values);
    va_end (values);
    execution.calls->error (&execution, text);
}

} /* end namespace Gelato */

#endif /* SHADEOP_H */
