// A plugin with one error, which a macro selects.
#include <stdexcept>

#include "imageio.h"

using namespace Gelato;

class BadOutput : public ImageOutput {
public:
    bool open (const char *name, const ImageIOFormatSpec &, int, const ImageIOParameter *, bool) {
#ifdef THROWS_OPEN
        throw std::runtime_error ("not today");
#endif
#ifdef FAILS_OPEN
        error ("no room for %s", name);
        return false;
#endif
        return true;
    }
    bool write_scanline (int, int, const float *, int) {
#ifdef FAILS_WRITE
        return false;
#endif
#ifdef THROWS_WRITE
        throw 7;
#endif
        return true;
    }
    bool close () {
#ifdef THROWS_CLOSE
        throw "not today";
#endif
        return true;
    }
};

extern "C" {
#ifdef VERSION
GELATO_EXPORT int imageio_version = IMAGEIO_VERSION - 1;
#elif ! defined(NOVERSION)
GELATO_EXPORT int imageio_version = IMAGEIO_VERSION;
#endif
#ifdef UNDEFINED
void nobody_has_this ();
GELATO_EXPORT void uses () { nobody_has_this (); }
#endif
#ifndef NOCREATE
GELATO_EXPORT ImageOutput *bad_output_imageio_create ()
{
#ifdef THROWS_CREATE
    throw std::runtime_error ("not today");
#endif
#ifdef NULLOBJECT
    return 0;
#endif
    return new BadOutput;
}
#endif
}
