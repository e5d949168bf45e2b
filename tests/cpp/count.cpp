// A shadeop that is not thread-safe, because it counts in a global variable. With LIES it declares that it is.
#include "shadeop.h"

using namespace Gelato;

static int calls;

extern "C" {
#ifdef LIES
GELATO_EXPORT int count_threadsafe = 1;
#endif
GELATO_EXPORT const char *count_shadeop[] = { "void count (output float)", NULL };
GELATO_EXPORT void count (ShadingExecution *exec, int, const ShaderArg *args)
{
    ++calls;
    for (ShadeGridIter i (exec, exec->isvarying (args[0])); ! i.done (); ++i)
        *(float *) args[0].data (i) = (float) calls;
}
}
